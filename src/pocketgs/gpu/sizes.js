/**
 * Sizes of buffers and dispatches as expressions; the twin of `sizes.py`.
 *
 * The expressions are valid JavaScript, but `Function` would run any code in a description, and pages that forbid
 * `eval` could not use it. So they are parsed: comparisons of sums of products of numbers, names, calls and brackets.
 *
 * @module
 */

/** @typedef {Object<string, number>} Symbols named numbers, such as the number of items or the image width in pixels */

const TOKEN = /\s*(\w+|[-+*()<>,])/y;

const OPERATORS = {
    "+": (a, b) => a + b,
    "-": (a, b) => a - b,
    "*": (a, b) => a * b,
    ">": (a, b) => Number(a > b),
    "<": (a, b) => Number(a < b),
};

const FUNCTIONS = new Map([
    ["ceil_div", (a, b) => Math.ceil(a / b)],
    ["max", Math.max],
]);

/** Operators by precedence, lowest first. */
const LEVELS = [[">", "<"], ["+", "-"], ["*"]];

/**
 * Evaluate an expression.
 *
 * @param {string} expression
 * @param {Symbols} symbols
 * @returns {number} an integer
 * @throws {Error} it is not an expression, or uses an unknown name
 */
export function evaluate(expression, symbols) {
    const tokens = tokensOf(expression);

    function take(expected) {
        const token = tokens.shift();
        if (token === undefined || (expected && token !== expected)) {
            throw new Error(`${expression}: found ${token ?? "its end"}, expected ${expected ?? "a number or a name"}`);
        }
        return token;
    }

    function valueAt(level) {
        if (level === LEVELS.length) {
            return operand();
        }
        let value = valueAt(level + 1);
        while (LEVELS[level].includes(tokens[0])) {
            value = OPERATORS[take()](value, valueAt(level + 1));
        }
        return value;
    }

    function operand() {
        const token = take();
        if (token === "(") {
            const value = valueAt(0);
            take(")");
            return value;
        }
        if (/^\d+$/.test(token)) {
            return Number(token);
        }
        if (FUNCTIONS.has(token)) {
            return call(FUNCTIONS.get(token));
        }
        if (Object.hasOwn(symbols, token)) {
            return symbols[token];
        }
        const names = Object.keys(symbols).join(", ");
        throw new Error(`${expression}: found ${token}, expected a number or one of ${names}`);
    }

    function call(operation) {
        take("(");
        const left = valueAt(0);
        take(",");
        const right = valueAt(0);
        take(")");
        return operation(left, right);
    }

    const value = valueAt(0);
    if (tokens.length) {
        throw new Error(`${expression}: found ${tokens[0]}, expected its end`);
    }
    return value;
}

function tokensOf(expression) {
    const tokens = [];
    const text = expression.trimEnd();
    TOKEN.lastIndex = 0;
    while (TOKEN.lastIndex < text.length) {
        const start = TOKEN.lastIndex;
        const match = TOKEN.exec(text);
        if (!match) {
            const found = text.slice(start).trim();
            throw new Error(`${expression}: found ${found}, expected a number, a name or an operator`);
        }
        tokens.push(match[1]);
    }
    return tokens;
}
