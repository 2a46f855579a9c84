// Certificates of service as the service makes them: how far one is, and the document once it is made.
import { age } from "./age.js";
import { answerOf, ask, passing } from "./api.js";
import { h } from "./dom.js";

const VERDICTS = { certified: "good", tested: "warn", "not certified": "bad" };

export const verdictTag = (verdict) => h("span", { class: `tag ${VERDICTS[verdict] ?? ""}` }, verdict);

function place({ controller, station, options }, behind, more = {}) {
  const query = new URLSearchParams({ station, ...(options ? { options } : {}), ...more });
  return `/v1/controllers/${encodeURIComponent(controller)}/certificate${behind}?${query}`;
}

// What is known of a certificate: begins nothing.
export const stateOf = (subject, signal) => ask(place(subject, "/state"), { signal });

export async function made(subject, of, signal, waiting) {
  // The document, or the check of it ("verification"), as a text that may be kept and sent: its figures are compared to
  // the last digit. Made if nobody has asked before, which takes seconds to minutes.
  const source = age.source(signal);
  try {
    for (;;) {
      const answered = source.asked();
      const found = await ask(place(subject, "", { of }), { method: "POST", signal }).catch((error) => {
        if (signal.aborted || !passing(error)) throw error;
      });
      if (found) answered();
      if (found?.state === "made" || found?.state === "failed") return (await answerOf(place(subject, of === "certificate" ? "" : `/${of}`), { signal })).text();
      waiting();
      await new Promise((wake) => setTimeout(wake, 1500));
      signal.throwIfAborted();
    }
  } finally {
    age.drop(source);
  }
}
