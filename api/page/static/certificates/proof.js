// The page of one question: claim in words, figures, pictures of the proof, and the check of it.
import { answerOf, ask, download, finished, long, post } from "../lib/api.js";
import { field, h, table } from "../lib/dom.js";
import { quantity, when, words } from "../lib/format.js";
import { constraintInWords, Proof } from "./document.js";
import { languageGraph } from "./graph.js";
import { ellipsoids, modesLegend, signal, tube } from "./pictures.js";

const ASKED = {
  stability: "Does every admissible signal decay?",
  "decay-rate": "How fast does the slowest admissible signal decay?",
  gain: "What is the largest l2 gain from disturbance to output?",
  "mean-square": "How fast does the mean square decay where modes jump by chance?",
  reach: "How far can a bounded disturbance drive the error?",
  stabilize: "Gains under which every admissible signal decays",
  "minimize-gain": "Gains of the smallest l2 gain",
  "minimize-reach": "Gains that keep the error in the smallest ball",
};

function figures(job, proof) {
  const { answer } = job;
  const { about } = proof ?? { about: {} };
  const rows = [
    ["value", answer.value?.toPrecision(7)],
    ["smallest tau", answer.tau && quantity(answer.tau, "samples")],
    ["before the loop was analysed", answer.bound?.toPrecision(7)],
    ["theorem", about.theorem],
    ["margin: least eigenvalue of all inequalities", about.margin?.toPrecision(3)],
    ["decimals kept of each entry", about.digits],
    ["nodes and inequalities", about.nodes && `${about.nodes}, ${about.inequalities}`],
    ["time to solve", about.solve_s !== undefined && quantity(about.solve_s, "s", 3)],
    ["time to check", about.verify_s !== undefined && quantity(about.verify_s, "s", 3)],
    ["whole answer", quantity(answer.seconds, "s", 2)],
  ];
  return table("Figures", ["figure", "value"], rows.filter(([, value]) => value));
}

function checker(place) {
  const said = h("p", { role: "status" });
  const button = h("button", { class: "primary", type: "button", onclick: async () => {
    button.disabled = true;
    said.textContent = "checking every inequality …";
    try {
      const text = await (await answerOf(place)).text(); // its figures are compared to the last digit
      const found = await post("/v1/certificates/verify", text, long);
      said.replaceChildren(h("span", { class: found.verified ? "tag good" : "tag bad" }, found.verified ? "verified" : "refused"),
        found.verified ? ` ${found.inequalities} inequalities hold in rational arithmetic, and every admissible signal is a path of the graph.` : ` ${found.claim}`);
    } catch (error) {
      said.textContent = error.message;
    }
    button.disabled = false;
  } }, "Verify again");
  return [button, said];
}

function pictures(proof) {
  const axes = Array.from({ length: proof.size }, (_, k) => h("option", { value: k }, `component ${k + 1}`));
  const choose = (chosen) => h("select", {}, axes.map((axis, k) => Object.assign(axis.cloneNode(true), { selected: k === chosen })));
  const [one, two, seed] = [choose(0), choose(Math.min(1, proof.size - 1)), h("input", { type: "number", min: "0", max: "999999", value: "0" })];
  const [shadow, band] = [h("div", {}), h("div", {})];
  const draw = () => {
    const chosen = Math.min(Math.max(Number(seed.value) || 0, 0), 999_999);
    shadow.replaceChildren(ellipsoids(proof, Number(one.value), Number(two.value)));
    band.replaceChildren(tube(proof, Number(one.value), signal(proof, chosen), chosen));
  };
  for (const control of [one, two, seed]) control.addEventListener("input", draw);
  draw();
  const reach = proof.kind === "reach";
  return h("div", { class: "stack" },
    h("section", { class: "card" }, h("h2", {}, "Ellipsoids"), h("p", { class: "hint" }, reach ? "One for each node of the graph: while the signal is there, the error lies inside." : "One for each node of the graph: level sets of the functions that fall along every signal, drawn to a largest half-axis of 1."),
      shadow, h("div", { class: "fields" }, field("Across", one), field("Up", two))),
    h("section", { class: "card" }, h("h2", {}, "Tube along a signal"), h("p", { class: "hint" }, reach ? "What the proof allows along one admissible signal, and six runs under disturbances at their bound." : "What the proof allows along one admissible signal, and six runs from the border of the first ellipsoid."),
      band, modesLegend(proof), h("div", { class: "fields" }, field("Signal", seed, { hint: "seed of the signal and the runs" }))));
}

function shown(root, job) {
  const { answer } = job;
  const document_ = answer.document;
  const proof = document_ && new Proof(document_);
  const drawable = proof?.shapes.length > 0 && proof.edges.length > 0;
  const claim = h("section", { class: "card claim" },
    h("p", { class: "statement" }, h("span", { class: answer.certified ? "tag good" : "tag warn" }, answer.certified ? "certified" : "not certified"), ` ${answer.claim}`),
    document_ && h("p", {}, "Admissible: ", constraintInWords(document_.problem.constraint), "."),
    proof?.word.length > 0 && h("p", {}, "Word: ", h("code", {}, proof.word.join(" "))));
  root.append(claim);
  if (document_) {
    const [button, said] = checker(`/v1/certificates/${job.id}/document`);
    claim.append(h("div", { class: "actions" }, button, h("button", { type: "button", onclick: () => download(`/v1/certificates/${job.id}/document`, `${job.id}.json`) }, "Download the document")), said);
  }
  const language = proof && h("section", { class: "card" }, h("h2", {}, "Language"), h("p", { class: "hint" }, "Every admissible signal is a path; a number at an arrow is a mode."), languageGraph(proof), modesLegend(proof));
  root.append(h("div", { class: "columns" }, h("div", { class: "stack" }, language, h("section", { class: "card" }, figures(job, proof))), drawable && pictures(proof)));
}

export async function showCertificate(root, id) {
  const abort = new AbortController();
  const path = `/v1/certificates/${encodeURIComponent(id)}`;
  const job = await ask(path);
  const state = h("p", { class: "lead", role: "status" }, `${words(job.state)} …`);
  root.append(h("div", { class: "head" }, h("div", {}, h("h1", {}, ASKED[job.ask]), h("p", { class: "lead" }, `${job.modes} modes, ${job.states} states, ${job.constraint} switching; asked ${when(job.created)}`)), h("a", { class: "button", href: "#/certificates" }, "All certificates")));
  const bar = h("progress", { "aria-label": "working" });
  const cancel = h("button", { type: "button", onclick: () => post(`${path}/cancel`) }, "Cancel");
  const waiting = h("section", { class: "card" }, state, bar, h("div", { class: "actions" }, cancel));
  root.append(waiting);
  finished(path, (now) => (state.textContent = `${words(now.state)} …`), abort.signal).then(async () => {
    const done = await ask(path);
    if (done.answer) {
      waiting.remove();
      shown(root, done);
    } else waiting.replaceChildren(h("p", { class: done.problem ? "problem" : "lead" }, done.problem?.detail ?? words(done.state)));
  }).catch((error) => !abort.signal.aborted && waiting.replaceChildren(h("p", { class: "problem", role: "alert" }, error.message)));
  return () => abort.abort();
}
