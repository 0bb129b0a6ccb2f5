/**
 * The focus, when what had it is hidden: those who use the keyboard or a screen reader would lose their place.
 *
 * @module
 */

/**
 * Give it to the first button of a card, unless something that is shown has it.
 *
 * @param {HTMLElement} card
 */
export function keepFocusIn(card) {
    const holder = document.activeElement;
    if (holder === document.body || !holder.checkVisibility()) {
        const buttons = [...card.querySelectorAll("button")];
        buttons.find((button) => button.checkVisibility() && !button.disabled)?.focus();
    }
}
