// The installed controllers; while the service compiles some, once for a version, a line above the view says so.
import { ask } from "./api.js";
import { set } from "./dom.js";

const AGAIN = 3000; // ms
let told = false;

export async function controllers({ signal } = {}) {
  const found = await ask("/v1/controllers", { signal });
  tell(found);
  return found;
}

function tell(found) {
  const waiting = found.filter(({ ready }) => !ready).map(({ name }) => name);
  const place = document.getElementById("compiling");
  place.hidden = !waiting.length;
  set(place, waiting.length ? `The service is compiling ${waiting.join(", ")}: once for this version, some minutes. Each can be used when it is done.` : "");
  if (!waiting.length || told) return;
  told = true; // by one chain of questions, however many views ask
  setTimeout(async () => {
    told = false;
    await controllers().catch(() => tell(found));
  }, AGAIN);
}
