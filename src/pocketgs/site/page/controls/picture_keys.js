/**
 * Keys that turn a picture while it has the focus: the arrows orbit, + and - zoom.
 *
 * @module
 */

/** Radians for each press, the same way as dragging. */
const TURN = Math.PI / 36;

/** Factor on the distance. */
const NEARER = 0.9;

const MOTIONS = {
    ArrowLeft: (camera) => camera.orbit(-TURN, 0),
    ArrowRight: (camera) => camera.orbit(TURN, 0),
    ArrowUp: (camera) => camera.orbit(0, -TURN),
    ArrowDown: (camera) => camera.orbit(0, TURN),
    "+": (camera) => camera.zoom(NEARER),
    // The same key without Shift.
    "=": (camera) => camera.zoom(NEARER),
    "-": (camera) => camera.zoom(1 / NEARER),
};

/**
 * Listen to the keyboard.
 *
 * @param {HTMLElement} element
 * @param {import("../../page/scene/camera.js").MovingCamera} camera
 * @param {() => void} onMove called when the camera has moved
 */
export function listenToPictureKeys(element, camera, onMove) {
    element.addEventListener("keydown", (event) => {
        const move = MOTIONS[event.key];
        if (move && !event.ctrlKey && !event.metaKey && !event.altKey) {
            event.preventDefault();
            move(camera);
            onMove();
        }
    });
}
