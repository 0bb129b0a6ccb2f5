/**
 * The focus, when what had it is hidden: those who use the keyboard or a screen reader would lose their place.
 *
 * @module
 */

/**
 * Give it to the first button of a card that can be pressed, unless something that is shown has it.
 *
 * @param {HTMLElement} card
 * @param {string} selector of the buttons that may have it
 */
export function keepFocusIn(card, selector = "button") {
    const holder = document.activeElement;
    if (holder === document.body || !holder.checkVisibility()) {
        const buttons = [...card.querySelectorAll(selector)];
        buttons.find((button) => button.checkVisibility() && !button.disabled)?.focus();
    }
}
