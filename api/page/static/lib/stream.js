// Server-sent events over fetch, since EventSource can send no key: it resumes by itself after a lost connection.
import { serviceClock } from "./age.js";
import { answerOf } from "./api.js";

const AGAIN = 500; // between two connections [ms]
const LATE = 10_000; // a stream that is so late is left: what waits in it is older than what a new one begins with [ms]

async function* blocks(answer) {
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  try {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      text += value;
      const whole = text.split("\n\n");
      text = whole.pop();
      yield* whole;
    }
  } finally {
    await reader.cancel().catch(() => {});
  }
}

export async function follow(path, { signal, opened, told }) {
  // `opened` is called at each (new) connection, before the first event; `told(kind, data)` for every event.
  let last;
  while (!signal.aborted) {
    try {
      const answer = await answerOf(path, { signal, accept: "text/event-stream", headers: last ? { "Last-Event-ID": last } : {} });
      await opened();
      for await (const block of blocks(answer)) {
        const fields = Object.fromEntries(block.split("\n").map((line) => [line.slice(0, line.indexOf(":")), line.slice(line.indexOf(":") + 2)]));
        last = fields.id ?? last;
        if (!fields.data) continue;
        const data = JSON.parse(fields.data);
        if (fields.event === "heartbeat") serviceClock.heard(1000 * data.sent);
        told(fields.event, data);
        if (fields.event === "heartbeat" && Date.now() - serviceClock.here(1000 * data.sent) > LATE) break;
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error.status === 404 || error.status === 409) throw error;
    }
    await new Promise((wake) => setTimeout(wake, AGAIN));
  }
}
