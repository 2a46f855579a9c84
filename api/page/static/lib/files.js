// A control that picks a file: the same file can be picked again after it was mended, in whatever way it comes.
import { h } from "./dom.js";

function copied({ files: [file] }) {
  // A browser tells no change where the same path comes twice, so the control holds a file that has none.
  const transfer = new DataTransfer();
  transfer.items.add(new File([file], file.name, { type: file.type, lastModified: file.lastModified }));
  return transfer.files;
}

export function fileInput(properties, picked) {
  const control = h("input", { type: "file", ...properties, onchange: () => {
    if (!control.files.length) return;
    control.files = copied(control);
    picked(control.files[0]);
  } });
  return control;
}
