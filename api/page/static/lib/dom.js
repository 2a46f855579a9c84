// Elements without a template language: `h` makes HTML, `s` makes SVG.

function filled(made, properties, children) {
  for (const [name, value] of Object.entries(properties ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made && typeof value !== "string" && !(made instanceof SVGElement)) made[name] = value;
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return made;
}

export const h = (name, properties, ...children) => filled(document.createElement(name), properties, children);

export const s = (name, properties, ...children) =>
  filled(document.createElementNS("http://www.w3.org/2000/svg", name), properties, children);

export function set(element, text) {
  // Change a text only where it differs, so that nothing is laid out in vain.
  const wanted = String(text);
  if (element.textContent !== wanted) element.textContent = wanted;
}

export function table(caption, headings, rows, { numeric = () => true } = {}) {
  // A table in a box that scrolls; a cell is a text, an element or null. The first column names the row.
  const head = headings.map((text, column) => h("th", { scope: "col", class: column && numeric(column) ? "number" : null }, text));
  const body = rows.map((cells) =>
    h("tr", {}, cells.map((cell, column) => (column ? h("td", { class: numeric(column) ? "number" : null }, cell ?? "–") : h("th", { scope: "row" }, cell)))),
  );
  return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    h("table", {}, h("caption", {}, caption), h("thead", {}, h("tr", {}, head)), h("tbody", {}, body)));
}

export function toast(text, kind = "note") {
  const shown = h("p", { class: `toast ${kind}` }, text);
  document.getElementById("toasts").append(shown);
  setTimeout(() => shown.remove(), kind === "problem" ? 9000 : 4000);
}

let made = 0;

export function field(label, control, { unit, hint } = {}) {
  // A labelled control with its unit, a hint and a place for what is wrong with it.
  const id = (control.id ||= `field-${++made}`);
  const wrong = h("span", { class: "wrong", id: `${id}-wrong` });
  control.setAttribute("aria-describedby", `${id}-hint ${id}-wrong`);
  return h("div", { class: "field" }, h("label", { for: id }, label, unit && h("span", { class: "unit" }, ` [${unit}]`)), control,
    h("span", { class: "hint", id: `${id}-hint` }, hint ?? ""), wrong);
}

export function complain(control, message) {
  // Say below a control what is wrong with it; an empty message takes it back.
  control.setAttribute("aria-invalid", String(Boolean(message)));
  const place = document.getElementById(`${control.id}-wrong`);
  if (place) place.textContent = message ?? "";
}

export function confirmed(title, text, action) {
  // Ask before something that cannot be taken back; resolves to whether it was wanted.
  const id = `confirm-${++made}`;
  const dialog = h("dialog", { "aria-labelledby": id },
    h("form", { method: "dialog" }, h("h2", { id }, title), h("p", {}, text),
      h("div", { class: "actions" }, h("button", { value: "no" }, "Cancel"), h("button", { value: "yes", class: "danger" }, action))));
  document.body.append(dialog);
  dialog.showModal();
  return new Promise((done) =>
    dialog.addEventListener("close", () => {
      dialog.remove();
      done(dialog.returnValue === "yes");
    }),
  );
}
