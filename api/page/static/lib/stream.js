// Server-sent events over fetch, since EventSource can send no key: it resumes by itself after a lost connection.
import { answerOf, connection } from "./api.js";

async function* blocks(answer) {
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const whole = text.split("\n\n");
    text = whole.pop();
    yield* whole;
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
        if (fields.data) told(fields.event, JSON.parse(fields.data));
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error.status === 404 || error.status === 409) throw error;
      connection.told(false);
    }
    await new Promise((wake) => setTimeout(wake, 1000));
  }
}
