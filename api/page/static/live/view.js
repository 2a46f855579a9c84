// The view "live": every twin, or the one that the address names.
import { listed } from "../lib/api.js";
import { showTwin } from "./twin.js";
import { showTwins } from "./twins.js";

export async function show(root, [id]) {
  const ending = new AbortController();
  const end = () => ending.abort();
  if (id) await showTwin(root, id, ending.signal);
  else if (!location.hash && (await openFirst())) return end;
  else await showTwins(root, ending.signal);
  return end;
}

async function openFirst() {
  // Who comes without an address sees a station that runs, where there is one.
  const items = await listed("/v1/twins");
  const running = items.find(({ state }) => state === "running");
  if (running) location.replace(`#/live/${running.id}`);
  return Boolean(running);
}
