// Which twins there are while one of them is shown: others may start and forget them at any time.
import { ask, listed } from "../lib/api.js";

const EVERY = 2000; // between two looks [ms]

const there = (path, signal) => ask(path, { signal }).then(() => true, (error) => error.status !== 404);

export function watchTwins(path, id, { shown, gone }, signal) {
  // `shown` hears of every list, `gone` once that there is no twin `id` any more. A list may lack what the database alone
  // knows, so that the twin itself is asked for.
  const look = async () => {
    const items = await listed("/v1/twins", { signal });
    if (items.some((each) => each.id === id) || (await there(path, signal))) return shown(items);
    return signal.aborted || gone();
  };
  const again = async () => {
    if (!document.hidden) await look().catch(() => {}); // the age of the view says how old it is
    if (!signal.aborted) setTimeout(again, EVERY);
  };
  setTimeout(again, EVERY);
}
