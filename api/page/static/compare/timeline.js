// The part of a result that asks for a schedule: which scenario, which replication, and how it is got.
import { alarm, h, set } from "../lib/dom.js";
import { gantt } from "./gantt.js";
import { replicationsOf } from "./jobs.js";
import { schedule } from "./schedule.js";

export function timeline(job, scenarios, controllers, rows, signal) {
  const scenario = h("select", { id: "gantt-scenario" }, scenarios.map(({ name }) => h("option", {}, name)));
  const replications = replicationsOf(job);
  const replication = h("select", { id: "gantt-replication" });
  const which = h("div", { class: "field" }, h("label", { for: replication.id }, "Replication"), replication);
  const offer = () => {
    const count = replications.get(scenario.value);
    replication.replaceChildren(...Array.from({ length: Math.min(count, 200) }, (_, place) => h("option", {}, place)));
    which.hidden = count === 1;
  };
  scenario.addEventListener("change", offer);
  offer();
  const draw = h("button", { class: "primary" }, "Show the schedule");
  const said = h("ul", { class: "said", "aria-live": "polite" });
  const problem = h("p", { role: "alert", hidden: true });
  const chart = h("div");
  let latest = 0;
  const load = async (turn) => {
    const chosen = scenarios.find(({ name }) => name === scenario.value);
    const lines = new Map(controllers.map((name) => [name, h("li", {}, `${name}: waiting`)]));
    said.replaceChildren(...lines.values());
    const told = (controller, text) => turn === latest && set(lines.get(controller), `${controller}: ${text}`);
    const found = await schedule({ scenario: chosen, controllers, replication: Number(replication.value), seed: job.seed, rows }, told, signal);
    if (turn !== latest) return;
    said.replaceChildren();
    chart.replaceChildren(gantt(found, chosen.name));
  };
  const asking = h("form", { class: "asking" },
    h("div", { class: "field" }, h("label", { for: scenario.id }, "Scenario"), scenario),
    which, draw);
  asking.addEventListener("submit", async (event) => {
    event.preventDefault();
    const turn = ++latest;
    alarm(problem, "");
    chart.setAttribute("aria-busy", "true");
    await load(turn).catch((error) => {
      if (signal.aborted || turn !== latest) return;
      said.replaceChildren();
      alarm(problem, error.message);
    });
    if (turn === latest) chart.removeAttribute("aria-busy");
  });
  return h("section", { class: "card schedule", "aria-labelledby": "gantt-title" },
    h("h2", { id: "gantt-title" }, "Who is served, and by which buffer"),
    h("p", { class: "lead" }, "A comparison keeps figures, not seconds. To show them, each controller's run is computed once more and its record kept; runs that are kept already are only read."),
    asking, problem, said, chart);
}
