/**
 * Keyboard controls: keys that fly while they are held, and keys that trigger actions.
 *
 * @module
 */

/** Directions (right, down, forward) of the keys that fly, by their position on the keyboard. */
const FLIGHT = {
    KeyW: [0, 0, 1],
    KeyS: [0, 0, -1],
    KeyA: [-1, 0, 0],
    KeyD: [1, 0, 0],
    KeyQ: [0, 1, 0],
    KeyE: [0, -1, 0],
};

/** Flying speed in distances to the target per second, and the factor with Shift. */
const SPEED = 0.6;
const FASTER = 3;

/**
 * Listen to the keyboard.
 *
 * @param {import("../scene/camera.js").MovingCamera} camera
 * @param {import("../drawing/frame_loop.js").FrameLoop} loop
 * @param {() => void} onFlight called when a flight begins
 * @param {Object<string, () => void>} actions by `KeyboardEvent.key`, letters in lower case
 */
export function listenToKeyboard(camera, loop, onFlight, actions) {
    const held = new Set();
    let fast = false;

    function fly(seconds) {
        const step = SPEED * (fast ? FASTER : 1) * camera.pose.distance * Math.min(seconds, 0.1);
        for (const code of held) {
            camera.move(FLIGHT[code].map((direction) => direction * step));
        }
        return held.size > 0;
    }

    window.addEventListener("keydown", (event) => {
        fast = event.shiftKey;
        const slides = event.target.matches?.("input") && event.key.startsWith("Arrow");
        if (event.ctrlKey || event.metaKey || event.altKey || slides || event.target.closest?.("dialog")) {
            return;
        }
        if (event.code in FLIGHT) {
            held.add(event.code);
            onFlight();
            loop.addMover(fly);
        } else if (!event.repeat && actions[event.key.toLowerCase()]) {
            event.preventDefault();
            actions[event.key.toLowerCase()]();
        }
    });
    window.addEventListener("keyup", (event) => {
        fast = event.shiftKey;
        held.delete(event.code);
        // Macs do not tell of keys that are released while this one is held.
        if (event.key === "Meta") {
            held.clear();
        }
    });
    window.addEventListener("blur", () => held.clear());
}
