/**
 * Mouse, wheel and touch: one pointer orbits, a second button or a second finger pans, wheel and pinch zoom.
 *
 * @module
 */

/** Rotation in radians for dragging over the canvas's shorter side. */
const TURN = Math.PI;

const ZOOM_PER_WHEEL_PIXEL = 0.0015;
const WHEEL_LINE = 16;

/** Moves a camera by pointer events on an element. */
export class PointerControls {
    #camera;
    #element;
    #onMove;
    #pointers = new Map();

    /**
     * @param {HTMLElement} element
     * @param {import("../scene/camera.js").MovingCamera} camera
     * @param {() => void} onMove called when the camera has moved
     */
    constructor(element, camera, onMove) {
        this.#element = element;
        this.#camera = camera;
        this.#onMove = onMove;
        element.addEventListener("pointerdown", (event) => this.#down(event));
        element.addEventListener("pointermove", (event) => this.#move(event));
        // A hidden element may lose a pointer without being told that it went up.
        for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
            element.addEventListener(end, (event) => this.#pointers.delete(event.pointerId));
        }
        element.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
        element.addEventListener("contextmenu", (event) => event.preventDefault());
    }

    #down(event) {
        this.#element.setPointerCapture(event.pointerId);
        this.#element.focus({ preventScroll: true });
        this.#pointers.set(event.pointerId, placeOf(event));
    }

    #move(event) {
        const before = this.#pointers.get(event.pointerId);
        if (!before) {
            return;
        }
        const now = placeOf(event);
        const side = Math.min(this.#element.clientWidth, this.#element.clientHeight);
        const [right, down] = [(now.x - before.x) / side, (now.y - before.y) / side];
        if (this.#pointers.size === 2) {
            this.#pinch(event.pointerId, now, right, down);
        } else if (event.buttons & 6 || event.shiftKey) {
            this.#camera.pan(right, down);
        } else if (this.#pointers.size === 1) {
            this.#camera.orbit(TURN * right, TURN * down);
        }
        this.#pointers.set(event.pointerId, now);
        this.#onMove();
    }

    /** Each finger moves the middle by half of its own motion. */
    #pinch(moved, now, right, down) {
        const before = this.#pointers.get(moved);
        const [, other] = [...this.#pointers].find(([id]) => id !== moved);
        const [apart, wasApart] = [now, before].map((place) => Math.hypot(place.x - other.x, place.y - other.y));
        this.#camera.pan(right / 2, down / 2);
        if (apart > 0 && wasApart > 0) {
            this.#camera.zoom(wasApart / apart);
        }
    }

    #wheel(event) {
        event.preventDefault();
        const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? WHEEL_LINE * event.deltaY : event.deltaY;
        this.#camera.zoom(Math.exp(ZOOM_PER_WHEEL_PIXEL * pixels));
        this.#onMove();
    }
}

function placeOf(event) {
    return { x: event.clientX, y: event.clientY };
}
