// What is proved of a controller's service at a station: claim, figures, the box, and the state that starves.
import { save } from "../lib/api.js";
import { h, table } from "../lib/dom.js";
import { number, quantity, words } from "../lib/format.js";
import { made, verdictTag } from "../lib/service.js";
import { speak } from "../lib/speak.js";
import { fraction } from "./matrix.js";

function box(found) {
  const rows = ["high", "medium", "low"].map((name, k) => [name, `${number(found.pressure_low_bar[k])} to ${number(found.pressure_high_bar[k])}`, `${number(found.temperature_low_c[k], 1)} to ${number(found.temperature_high_c[k], 1)}`]);
  return table("From every state of this box", ["buffer", "pressure [bar]", "temperature [°C]"], rows);
}

function limits({ bounds, uncertainty }) {
  const rows = bounds.map(({ limit, equation, margin, unit }) => [words(limit), `(${equation})`, number(fraction(margin), 3), unit]);
  return h("section", { class: "card" }, table("Limits under error: the margin a reading must keep", ["limit", "equation", "margin", "unit"], rows, { numeric: (column) => column === 2 }), h("p", { class: "hint" }, `No limit is broken while parameters err by at most ${quantity(100 * uncertainty.parameters, "%", 1)}, readings by ${quantity(uncertainty.pressure_bar, "bar", 1)} and ${quantity(uncertainty.temperature_k, "K", 1)}.`));
}

function figures({ seen, tested, proof, promised_s: promised, burst, spacing_s: spacing }) {
  const seconds = (value) => (value === null || value === undefined ? null : quantity(value, "s"));
  const rows = [
    [`every vehicle finished so soon after ${burst > 1 ? "arrival" : "connection"}`, seconds(promised)],
    [burst > 1 ? `arrivals in bursts of up to ${burst}, so far apart on the mean` : "arrivals at least s apart", seconds(spacing)],
    ["fills seen in S1-S4", `${number(seen.fills)}: mean ${seconds(seen.mean_fill_s)}, longest ${seconds(seen.worst_fill_s)}`],
    ["tested", tested && `${number(tested.simulations)} runs, ${number(tested.vehicles)} vehicles, longest ${burst > 1 ? "stay" : "fill"} ${seconds(tested.worst_fill_s)}`],
    ["proved", proof && (proof.complete ? `${number(proof.cells)} cells, no fill longer than ${seconds(proof.longest_fill_s)}` : `not the whole box: ${proof.open}`)],
  ];
  return table("Figures", ["figure", "value"], rows.filter(([, value]) => value), { numeric: () => false, wide: 1 });
}

function starving(found) {
  const lasts = found.fill_s === null ? "is never finished" : `is connected for ${quantity(found.fill_s, "s")}`;
  const rows = ["high", "medium", "low"].map((name, k) => [name, number(found.state[k], 1), number(found.state[k + 3], 1)]);
  return h("section", { class: "card" }, h("h2", {}, "A state that starves"), h("p", {}, `From here a vehicle ${lasts}.`), table("Buffers at the start", ["buffer", "pressure [bar]", "temperature [°C]"], rows));
}

function shown(text, name, check) {
  const found = JSON.parse(text);
  const claim = h("section", { class: "card claim" },
    h("p", { class: "statement" }, verdictTag(found.verdict), ` ${found.claim}`), check(found));
  claim.querySelector(".actions").append(h("button", { type: "button", onclick: () => save(new Blob([text], { type: "application/json" }), `${name}.json`) }, "Download the document"));
  return [claim, h("div", { class: "columns" }, h("div", { class: "stack" }, h("section", { class: "card" }, figures(found)), h("section", { class: "card" }, box(found.box)), found.counterexample && starving(found.counterexample)), limits(found.limits))];
}

export async function showService(root, controller, station, options) {
  const abort = new AbortController();
  const subject = { controller, station, options };
  const name = [controller, options].filter(Boolean).join(":");
  root.append(h("div", { class: "head" }, h("div", {}, h("h1", {}, `Service of ${name}`), h("p", { class: "lead" }, `at station ${station}`)), h("a", { class: "button", href: "#/certificates" }, "All certificates")));
  const state = h("p", { class: "lead" }, "asking …");
  const waiting = h("section", { class: "card" }, state, h("progress", { "aria-label": "working" }));
  root.append(waiting);
  const began = performance.now();
  const told = (text) => () => {
    state.textContent = `${text}, ${quantity((performance.now() - began) / 1000, "s")} …`;
    speak(text);
  };
  const check = () => {
    const said = h("p", {});
    const button = h("button", { class: "primary", type: "button", onclick: async () => {
      button.disabled = true;
      const start = performance.now();
      try {
        const checked = await made(subject, "verification", abort.signal, () => (said.textContent = `computing everything anew, ${quantity((performance.now() - start) / 1000, "s")} …`));
        const found = JSON.parse(checked);
        speak(found.verified ? "verified" : "refused");
        said.replaceChildren(h("span", { class: found.verified ? "tag good" : "tag bad" }, found.verified ? "verified" : "refused"), ` ${found.claim}`);
      } catch (error) {
        if (!abort.signal.aborted) said.textContent = error.message;
      }
      button.disabled = false;
    } }, "Verify again");
    return h("div", { class: "check" }, h("div", { class: "actions" }, button), said);
  };
  made(subject, "certificate", abort.signal, told("simulating, searching and proving"))
    .then((text) => waiting.replaceWith(...shown(text, `${name.replaceAll(":", "-")}-${station}`, check)))
    .catch((error) => !abort.signal.aborted && waiting.replaceChildren(h("p", { class: "problem", role: "alert" }, error.message)));
  return () => abort.abort();
}
