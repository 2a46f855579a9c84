// Requests to the service: one place for keys, problems, patience and the state of the connection.
import { STALE, age, serviceClock } from "./age.js";

export class Problem extends Error {
  // A problem document (RFC 9457): `fields` maps a wrong field to what is wrong with it.
  constructor(status, found) {
    const fields = (found.errors ?? []).map(({ field, message }) => [field, message]);
    super([found.detail ?? found.title ?? `status ${status}`, ...fields.map((each) => each.join(": "))].join("; "));
    this.status = status;
    this.fields = new Map(fields);
  }
}

// A request that brought no answer: a command may have been done all the same.
export class NoAnswer extends Error {}

const PATIENCE = 10_000; // a request, or the next part of its answer, is waited for so long [ms]
const LOOK = 1000; // between two looks whether the service answers [ms]
const LOOKS = 2; // at once: a browser has few connections, and commands need one
const UNCONFIRMED = 2000; // a command without an answer for so long is said to be not confirmed [ms]

class Connection extends EventTarget {
  // Whether the service answers, and how many commands it has not confirmed; says "change".
  lost = false;
  unconfirmed = 0;
  #looks = 0;

  told(answered) {
    if (this.lost === !answered) return;
    this.lost = !answered;
    this.dispatchEvent(new Event("change"));
  }

  async confirmed(command) {
    // A command that is on its way: what it comes to.
    const count = (by) => {
      this.unconfirmed += by;
      this.dispatchEvent(new Event("change"));
    };
    let counted = false;
    const timer = setTimeout(() => count((counted = 1)), UNCONFIRMED);
    try {
      return await command;
    } finally {
      clearTimeout(timer);
      if (counted) count(-1);
    }
  }

  watch() {
    setInterval(() => !document.hidden && this.#look(), LOOK);
    document.addEventListener("visibilitychange", () => !document.hidden && this.#look());
    this.#look();
  }

  async #look() {
    if (this.#looks >= LOOKS) return;
    this.#looks++;
    const asked = Date.now();
    try {
      const { sent } = await ask("/livez", { patience: STALE });
      serviceClock.heard(1000 * sent, asked);
      age.service.told(1000 * sent);
    } catch {
      this.told(false);
    }
    this.#looks--;
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

function patient(answer, timer) {
  // The answer, whose body may take as long as it likes while it goes on coming.
  if (!answer.body || answer.status === 204) { // which may have a body of no bytes, and must not be given one
    timer.stop();
    return answer;
  }
  const body = answer.body.pipeThrough(new TransformStream({ transform: (chunk, control) => (timer.begin(), control.enqueue(chunk)), flush: () => timer.stop() }));
  const { status, statusText, headers } = answer;
  return new Response(body, { status, statusText, headers });
}

function stopwatch(patience) {
  // Ends what has its signal when nothing has come for so long.
  const ending = new AbortController();
  let timer;
  const begin = () => {
    clearTimeout(timer);
    timer = setTimeout(() => ending.abort(new NoAnswer(`the service has not answered for ${patience / 1000} s`)), patience);
  };
  begin();
  return { signal: ending.signal, begin, stop: () => clearTimeout(timer) };
}

// A `body` that is a text is sent as it is: a document may hold 0.0, which JavaScript would write as 0.
async function request(path, { method = "GET", body, signal, accept, headers: more, patience = PATIENCE } = {}) {
  const key = sessionStorage.getItem("hrs-key");
  const headers = { ...more };
  if (key) headers.authorization = `Bearer ${key}`;
  if (accept) headers.accept = accept;
  if (body !== undefined) headers["content-type"] = "application/json";
  const timer = stopwatch(patience);
  const either = signal ? AbortSignal.any([signal, timer.signal]) : timer.signal;
  const answering = fetch(path, { method, headers, signal: either, body: body === undefined || typeof body === "string" ? body : JSON.stringify(body) });
  try {
    const answer = await (method === "GET" ? answering : connection.confirmed(answering));
    connection.told(true);
    return patient(answer, timer);
  } catch (error) {
    timer.stop();
    if (signal?.aborted) throw error;
    if (!(error instanceof NoAnswer)) connection.told(false);
    const why = error instanceof NoAnswer ? error.message : "the service does not answer";
    throw new NoAnswer(method === "GET" ? why : `not confirmed, ${why}: look whether it was done before you do it again`);
  }
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
  if (answer.status === 204) return null;
  return answer.json().catch((error) => {
    if (options.signal?.aborted || error instanceof SyntaxError) throw error;
    throw new NoAnswer("the service has not answered to the end");
  });
}

const PAGE = 200; // the most that the service gives at once

export async function listed(path, options) {
  // Every item of a list, page by page.
  const items = [];
  for (let cursor = ""; cursor !== null; ) {
    const page = await ask(`${path}?limit=${PAGE}${cursor ? `&cursor=${cursor}` : ""}`, options);
    items.push(...page.items);
    cursor = page.next;
  }
  return items;
}

export const post = (path, body = {}, more = {}) => ask(path, { method: "POST", body, ...more });

const LONG = 120_000; // for what takes the service long to make, or to check [ms]

export const long = { patience: LONG };

export function save(blob, name) {
  // Hand a file to the user.
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Save what a GET answers as a file.
export const download = async (path, name) => save(await (await answerOf(path, long)).blob(), name);

// Save a document as JSON.
export const saveJson = (document_, name) => save(new Blob([JSON.stringify(document_, null, 1)], { type: "application/json" }), name);

export const passing = (error) => error instanceof NoAnswer || error.status >= 500 || error.status === 429;

export async function finished(path, told, signal) {
  // Follow a job until it has ended; `told` hears of every state.
  const source = age.source(signal);
  try {
    for (let wait = 150; ; wait = Math.min(wait * 1.4, 1500)) {
      try {
        const answered = source.asked();
        const job = await ask(path, { signal });
        answered();
        told(job);
        if (job.finished) return job;
      } catch (error) {
        if (signal?.aborted || !passing(error)) throw error;
      }
      await new Promise((wake) => setTimeout(wake, wait));
      signal?.throwIfAborted();
    }
  } finally {
    age.drop(source);
  }
}
