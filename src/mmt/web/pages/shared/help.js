// The list of keys: opened by "?" or its button, closed by Escape.

const dialog = document.getElementById("help");

/** Say whether a key belongs to what a person types in, or to the open list of keys. */
export function isTaken(event) {
  return dialog.open || event.ctrlKey || event.metaKey || event.altKey
    || event.target.closest("input:not([type=range]), select, textarea") !== null;
}

/** Offer the keys of a page of this kind: "live" or "recording". */
export function offerHelp(kind) {
  for (const part of dialog.querySelectorAll("[data-page]")) part.hidden = part.dataset.page !== kind;
  const open = () => dialog.showModal();
  document.getElementById("help-open").onclick = open;
  document.getElementById("help-close").onclick = () => dialog.close();
  addEventListener("keydown", (event) => {
    if (event.key !== "?" || isTaken(event)) return;
    event.preventDefault();
    open();
  });
}
