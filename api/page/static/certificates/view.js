// Certificates: what was asked and proved, a page for each proof, and a check of any document.
import { ask, post } from "../lib/api.js";
import { complain, field, h, table, toast } from "../lib/dom.js";
import { when, words } from "../lib/format.js";
import { askAboutController, askAboutSystem } from "./ask.js";
import { showCertificate } from "./proof.js";
import { showService } from "./service.js";

export const verdict = (job) => {
  if (!job.answer) return h("span", { class: job.state === "failed" ? "tag bad" : "tag" }, words(job.state));
  return h("span", { class: job.answer.certified ? "tag good" : "tag warn" }, job.answer.certified ? "certified" : "not certified");
};

async function list(place, cursor) {
  const page = await ask(`/v1/certificates?limit=20${cursor ? `&cursor=${cursor}` : ""}`);
  const rows = page.items.map((job) => [
    h("a", { href: `#/certificates/${job.id}` }, words(job.ask.replace("-", " "))),
    verdict(job),
    `${job.modes} modes, ${job.states} states, ${job.constraint}`,
    job.answer?.claim ?? job.problem?.detail ?? "",
    when(job.created),
  ]);
  if (!rows.length && !cursor) {
    place.replaceChildren(h("p", { class: "empty" }, "Nothing has been asked yet. Ask about a switched system or a controller above."));
    return;
  }
  place.querySelector(".more")?.remove();
  place.append(table(cursor ? "Earlier questions" : "Questions about switched systems", ["asked", "verdict", "of", "claim", "when"], rows, { numeric: () => false, wide: 3 }));
  if (page.next) place.append(h("button", { class: "more", type: "button", onclick: () => list(place, page.next).catch((error) => toast(error.message, "problem")) }, "Earlier ones"));
}

function checkCard() {
  const text = h("textarea", { rows: 5, name: "document", spellcheck: false, placeholder: '{"format": "hrs-certificate", ...}' });
  const file = h("input", { type: "file", accept: ".json,application/json", onchange: async () => (text.value = (await file.files[0]?.text()) ?? "") });
  const said = h("p", { role: "status" });
  const form = h("form", { class: "card", novalidate: true, onsubmit: async (event) => {
    event.preventDefault();
    said.replaceChildren();
    let given;
    try {
      given = JSON.parse(text.value);
      complain(text, "");
    } catch (error) {
      complain(text, `is no JSON document: ${error.message}`);
      return;
    }
    try {
      const found = await post("/v1/certificates/verify", given);
      said.append(h("span", { class: found.verified ? "tag good" : "tag bad" }, found.verified ? "verified" : "refused"), ` ${found.claim}`,
        found.verified ? `; ${found.inequalities} inequalities hold in rational arithmetic` : "");
    } catch (error) {
      complain(text, error.message);
    }
  } },
    h("h2", {}, "Check a document"),
    h("p", { class: "lead" }, "Every inequality again, in rational arithmetic; nothing that the document says about itself is believed."),
    field("File", file), field("Document", text, { hint: "as hrs certify writes it" }), h("div", { class: "actions" }, h("button", { class: "primary" }, "Verify")), said);
  return form;
}

export async function show(root, [id, controller, station, options]) {
  if (id === "service") return showService(root, controller, station, options ?? "");
  if (id) return showCertificate(root, id);
  const questions = h("section", { class: "card", "aria-label": "Questions" });
  root.append(h("div", { class: "head" }, h("h1", {}, "Certificates")),
    h("p", { class: "lead" }, "A claim about every signal a policy may produce, with a proof that anybody can check."),
    h("div", { class: "columns" }, h("div", { class: "stack" }, await askAboutController(), checkCard()), await askAboutSystem()), questions);
  await list(questions);
}
