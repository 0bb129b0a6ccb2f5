/**
 * Following a run by requests, for browsers that open no WebSocket to its server.
 *
 * @module
 */

const SECONDS_BETWEEN_REQUESTS = 1;

/**
 * @param {import("./socket.js").Receiver} receiver
 * @returns {import("./socket.js").Connection}
 */
export function followByPolling(receiver) {
    poll(receiver).catch(receiver.onClose);
    return { send };
}

/** Ask for what is new, until a request fails. */
async function poll({ onOpen, onMessage, onScene }) {
    for (let read = null; ; await pause()) {
        const response = await answer(`news.json?${new URLSearchParams(read ?? {})}`);
        const news = await response.json();
        if (!read) {
            onOpen();
        }
        read = news.read;
        for (const message of news.messages) {
            onMessage(message);
            if (message.type === "scene") {
                onScene(await (await answer(`snapshot.${message.format}`)).arrayBuffer());
            }
        }
    }
}

async function send(type) {
    await answer("live", { method: "POST", body: JSON.stringify({ type }) });
}

async function answer(url, options) {
    const response = await fetch(url, options);
    if (!response.ok) {
        throw new Error(`${url}: the server answers ${response.status}`);
    }
    return response;
}

function pause() {
    return new Promise((resolve) => setTimeout(resolve, 1000 * SECONDS_BETWEEN_REQUESTS));
}
