// Requests to the service: one place for keys, problems and the state of the connection.

export class Problem extends Error {
  // A problem document (RFC 9457): `fields` maps a wrong field to what is wrong with it.
  constructor(status, found) {
    const fields = (found.errors ?? []).map(({ field, message }) => [field, message]);
    super([found.detail ?? found.title ?? `status ${status}`, ...fields.map((each) => each.join(": "))].join("; "));
    this.status = status;
    this.fields = new Map(fields);
  }
}

class Connection extends EventTarget {
  // Whether the service answers: every request tells, and while none is asked a light one is made.
  lost = false;
  #known = false;

  told(answered) {
    if (this.#known && this.lost === !answered) return;
    this.#known = true;
    this.lost = !answered;
    this.dispatchEvent(new Event("change"));
  }

  watch() {
    const ask = async () => {
      await request("/openapi.json", { method: "HEAD" }).catch(() => {});
      setTimeout(ask, this.lost ? 1000 : 5000);
    };
    ask();
  }
}

export const connection = new Connection();

async function askForKey() {
  const dialog = document.getElementById("key");
  const form = dialog.querySelector("form");
  form.reset();
  dialog.returnValue = "cancel";
  if (!dialog.open) dialog.showModal();
  await new Promise((done) => dialog.addEventListener("close", done, { once: true }));
  if (dialog.returnValue !== "ok") return false;
  sessionStorage.setItem("hrs-key", form.elements.key.value.trim());
  return true;
}

// A `body` that is a text is sent as it is: a document may hold 0.0, which JavaScript would write as 0.
async function request(path, { method = "GET", body, signal, accept, headers: more } = {}) {
  const key = sessionStorage.getItem("hrs-key");
  const headers = { ...more };
  if (key) headers.authorization = `Bearer ${key}`;
  if (accept) headers.accept = accept;
  if (body !== undefined) headers["content-type"] = "application/json";
  let answer;
  try {
    answer = await fetch(path, { method, headers, signal, body: body === undefined || typeof body === "string" ? body : JSON.stringify(body) });
  } catch (error) {
    if (error.name !== "AbortError") connection.told(false);
    throw error.name === "AbortError" ? error : new Error("the service does not answer");
  }
  connection.told(true);
  return answer;
}

let asking = null; // one dialog for all requests that wait for a key

export async function answerOf(path, options = {}) {
  // The response to a request that succeeded.
  const answer = await request(path, options);
  if (answer.status === 401) {
    asking ??= askForKey().finally(() => (asking = null));
    if (await asking) return answerOf(path, options);
  }
  if (answer.ok) return answer;
  throw new Problem(answer.status, await answer.json().catch(() => ({})));
}

export async function ask(path, options = {}) {
  // The JSON that a request is answered with; null where there is no content.
  const answer = await answerOf(path, options);
  return answer.status === 204 ? null : answer.json();
}

export async function listed(path, options) {
  // Every item of a list, page by page.
  const items = [];
  for (let cursor = ""; cursor !== null; ) {
    const page = await ask(cursor ? `${path}?cursor=${cursor}` : path, options);
    items.push(...page.items);
    cursor = page.next;
  }
  return items;
}

export const post = (path, body = {}) => ask(path, { method: "POST", body });

export function save(blob, name) {
  // Hand a file to the user.
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Save what a GET answers as a file.
export const download = async (path, name) => save(await (await answerOf(path)).blob(), name);

// Save a document as JSON.
export const saveJson = (document_, name) => save(new Blob([JSON.stringify(document_, null, 1)], { type: "application/json" }), name);

export async function finished(path, told, signal) {
  // Follow a job until it has ended; `told` hears of every state.
  for (let wait = 150; ; wait = Math.min(wait * 1.4, 1500)) {
    try {
      const job = await ask(path, { signal });
      told(job);
      if (job.finished) return job;
    } catch (error) {
      if (signal?.aborted || error instanceof Problem) throw error;
    }
    await new Promise((wake) => setTimeout(wake, wait));
    signal?.throwIfAborted();
  }
}
