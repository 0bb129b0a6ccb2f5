/**
 * Requests to the server.
 *
 * @module
 */

/** An answer that says what is wrong: `message` is for the user. */
export class RefusedError extends Error {
    constructor(status, { error, ...facts }) {
        super(error ?? `the server answers ${status}`);
        this.status = status;
        this.facts = facts;
    }
}

/** @type {(path: string) => Promise<Object>} */
export function ask(path) {
    return answered(fetch(path));
}

/** @type {(path: string, content?: Object) => Promise<Object>} */
export function tell(path, content = {}) {
    return answered(fetch(path, { method: "POST", body: JSON.stringify(content) }));
}

/** @type {(path: string, piece: ArrayBuffer, signal: AbortSignal) => Promise<Object>} */
export function put(path, piece, signal) {
    return answered(fetch(path, { method: "PUT", body: piece, signal }));
}

async function answered(promise) {
    const response = await promise.catch(unanswered);
    // What stands between may refuse a request in its own words; but an answer that breaks off says nothing.
    const content = await response.json().catch((error) => (response.ok ? unanswered(error) : {}));
    if (!response.ok) {
        throw new RefusedError(response.status, content);
    }
    return content;
}

/** Throws what to say of a request without an answer, or with half of one. */
function unanswered(error) {
    const isBroken = error instanceof TypeError || error instanceof SyntaxError;
    throw isBroken ? new Error("the computer does not answer") : error;
}
