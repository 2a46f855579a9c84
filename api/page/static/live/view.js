import { h } from "../lib/dom.js";

export async function show(root) {
  root.append(h("div", { class: "head" }, h("h1", {}, "Live")));
}
