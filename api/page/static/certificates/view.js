// Certificates: what was asked and proved, a page for each proof, and a check of any document.
import { repeated } from "../lib/age.js";
import { listed, long, post } from "../lib/api.js";
import { complain, field, h, set } from "../lib/dom.js";
import { fileInput } from "../lib/files.js";
import { when, words } from "../lib/format.js";
import { List } from "../lib/list.js";
import { askAboutController, askAboutSystem } from "./ask.js";
import { showCertificate } from "./proof.js";
import { showService } from "./service.js";

const EVERY = 3000; // the list is asked for anew [ms]

export const verdict = (job) => {
  if (!job.answer) return h("span", { class: job.state === "failed" ? "tag bad" : "tag" }, words(job.state));
  return h("span", { class: job.answer.certified ? "tag good" : "tag warn" }, job.answer.certified ? "certified" : "not certified");
};

class Line {
  constructor(job) {
    this.tag = h("span");
    this.claim = h("p", { class: "hint" });
    this.element = h("li", {}, h("div", { class: "head" }, h("a", { href: `#/certificates/${job.id}` }, words(job.ask.replace("-", " "))), this.tag),
      h("p", { class: "hint" }, `${job.modes} modes, ${job.states} states, ${job.constraint} · ${when(job.created)}`), this.claim);
    this.show(job);
  }

  show(job) {
    const made = verdict(job);
    if (this.tag.textContent !== made.textContent) this.tag.replaceChildren(made);
    set(this.claim, job.answer?.claim ?? job.problem?.detail ?? "");
  }
}

async function questions(signal) {
  const list = new List({
    label: "questions", className: "questions", line: (job) => new Line(job), kind: (job) => verdict(job).textContent,
    text: (job) => [job.id, job.ask, job.constraint, job.state, job.answer?.claim ?? "", when(job.created)].join(" "),
    empty: h("p", { class: "empty" }, "Nothing has been asked yet. Ask about a switched system or a controller above."),
  });
  await repeated(EVERY, async () => list.show(await listed("/v1/certificates", { signal })), signal);
  return h("section", { class: "card", "aria-label": "Questions" }, h("h2", {}, "Questions about switched systems"), list.element);
}

function checkCard() {
  const text = h("textarea", { rows: 5, name: "document", spellcheck: false, placeholder: '{"format": "hrs-certificate", ...}' });
  const file = fileInput({ accept: ".json,application/json" }, async (picked) => (text.value = await picked.text()));
  const said = h("p", { role: "status" });
  const form = h("form", { class: "card", novalidate: true, onsubmit: async (event) => {
    event.preventDefault();
    said.replaceChildren("checking …");
    try {
      JSON.parse(text.value);
      complain(text, "");
    } catch (error) {
      said.replaceChildren();
      complain(text, `is no JSON document: ${error.message}`);
      return;
    }
    try {
      const found = await post("/v1/certificates/verify", text.value, long); // as it is: 1.0 is not 1
      said.replaceChildren(h("span", { class: found.verified ? "tag good" : "tag bad" }, found.verified ? "verified" : "refused"), ` ${found.claim}`,
        found.inequalities ? `; ${found.inequalities} inequalities hold in rational arithmetic` : "");
    } catch (error) {
      said.replaceChildren();
      complain(text, error.message);
    }
  } },
    h("h2", {}, "Check a document"),
    h("p", { class: "lead" }, "A claim about a switched system or about a controller's service, proved again; nothing that the document says about itself is believed."),
    field("File", file), field("Document", text, { hint: "as hrs certify writes it, or as it is downloaded here" }), h("div", { class: "actions" }, h("button", { class: "primary" }, "Verify")), said);
  return form;
}

export async function show(root, [id, controller, station, options]) {
  if (id === "service") return showService(root, controller, station, options ?? "");
  if (id) return showCertificate(root, id);
  const ending = new AbortController();
  root.append(h("div", { class: "head" }, h("h1", {}, "Certificates")),
    h("p", { class: "lead" }, "A claim about every signal a policy may produce, with a proof that anybody can check."),
    h("div", { class: "columns" }, h("div", { class: "stack" }, await askAboutController(), checkCard()), await askAboutSystem()), await questions(ending.signal));
  return () => ending.abort();
}
