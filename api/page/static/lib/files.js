// A control that picks a file: the same file can be picked again after it was mended.
import { h } from "./dom.js";

export function fileInput(properties, picked) {
  // A browser tells no change where the same name is picked twice, so each pick begins with none.
  const control = h("input", { type: "file", ...properties, onclick: () => (control.value = ""), onchange: () => control.files.length && picked(control.files[0]) });
  return control;
}
