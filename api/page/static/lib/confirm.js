// A question before something cannot be taken back.
import { h } from "./dom.js";

export async function confirmed(title, text, action) {
  // Whether the user chose `action` in a dialog; Escape and "Cancel" say no.
  const heading = h("h2", { id: "confirm-title" }, title);
  const dialog = h("dialog", { "aria-labelledby": heading.id },
    h("form", { method: "dialog" }, heading, h("p", {}, text),
      h("div", { class: "actions" }, h("button", { value: "" }, "Cancel"), h("button", { value: "yes", class: "danger" }, action))));
  document.body.append(dialog);
  dialog.showModal();
  await new Promise((done) => dialog.addEventListener("close", done, { once: true }));
  dialog.remove();
  return dialog.returnValue === "yes";
}
