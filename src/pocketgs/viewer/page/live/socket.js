/**
 * Following a run over a WebSocket.
 *
 * @module
 */

/**
 * What becomes of a connection to a run. Every way of following one calls these.
 *
 * @typedef {Object} Receiver
 * @property {() => void} onOpen called before the first message
 * @property {(message: Object) => void} onMessage
 * @property {(data: ArrayBuffer) => void} onScene called after the message that announces the scene
 * @property {() => void} onClose called once: nothing comes any more
 *
 * @typedef {Object} Connection
 * @property {(command: string) => void | Promise<void>} send throws where there is no connection; by requests,
 *     also if the server refuses
 */

/**
 * @param {Receiver} receiver
 * @returns {Connection}
 */
export function followBySocket({ onOpen, onMessage, onScene, onClose }) {
    const url = new URL("live", document.baseURI);
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", onOpen);
    socket.addEventListener("message", ({ data }) =>
        data instanceof ArrayBuffer ? onScene(data) : onMessage(JSON.parse(data)),
    );
    socket.addEventListener("close", onClose);
    return { send: (type) => send(socket, type) };
}

function send(socket, type) {
    // A closed socket takes what it is given, and sends nothing.
    if (socket.readyState !== WebSocket.OPEN) {
        throw new Error("no connection to the computer");
    }
    socket.send(JSON.stringify({ type }));
}
