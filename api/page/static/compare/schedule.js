// The runs behind a schedule: those the service keeps already, or new ones; who is served and which valve is open when.
import { ask, finished, post } from "../lib/api.js";

export const VALVES = ["outlet_high", "outlet_medium", "outlet_low", "inlet_high", "inlet_medium", "inlet_low"];

const ours = new Map(); // runs this page has found or made, by what they answer

async function kept(question, row, stored, signal) {
  // A stored run that answers the same question: one of its names whose every figure of merit is the comparison's.
  const known = ours.get(JSON.stringify(question));
  if (known) {
    const run = await ask(`/v1/runs/${known}`, { signal }).catch(() => null);
    if (run && ["queued", "running", "succeeded"].includes(run.state)) return run;
  }
  if (!row) return null;
  const { scenario, controller, replication, seed } = question;
  return stored.find((run) => run.scenario === scenario.name && run.station === scenario.station.name && run.controller === controller &&
    run.replication === replication && run.seed === seed && Object.entries(run.metrics ?? {}).every(([name, value]) => value === row[name]));
}

export function spans(time, open) {
  // From when to when something is open: a row holds until the next.
  const found = [];
  let since = null;
  for (let row = 0; row < time.length; row += 1) {
    if (open[row] && since === null) since = time[row];
    if (!open[row] && since !== null) {
      found.push([since, time[row]]);
      since = null;
    }
  }
  if (since !== null && time.at(-1) > since) found.push([since, time.at(-1)]);
  return found;
}

async function read(controller, run, signal) {
  const [series, about] = await Promise.all([
    ask(`/v1/runs/${run.id}/series?columns=${VALVES.join(",")}`, { signal }),
    ask(`/v1/runs/${run.id}/vehicles`, { signal }),
  ]);
  const { time, ...columns } = series.columns;
  const vehicles = about.columns.arrival.map((arrival, place) => ({
    arrival, connected: about.columns.connected[place], finished: about.columns.finished[place],
  }));
  return { controller, run: run.id, end: time.at(-1), vehicles, valves: Object.fromEntries(VALVES.map((valve) => [valve, spans(time, columns[valve])])) };
}

export async function schedule({ scenario, controllers, replication, seed, rows }, told, signal) {
  // Every controller's schedule; `told(controller, text)` hears how each is got.
  const stored = rows ? (await ask("/v1/runs?state=succeeded&limit=200", { signal })).items : [];
  return Promise.all(controllers.map(async (controller) => {
    const question = { scenario, controller, replication, seed };
    const row = rows?.find((each) => each.scenario === scenario.name && each.controller === controller && each.replication === replication);
    let run = await kept(question, row, stored, signal);
    told(controller, run ? "stored already, reading it" : "computing it and keeping its record");
    run ??= await post("/v1/runs", question);
    ours.set(JSON.stringify(question), run.id);
    const done = run.finished ? run : await finished(`/v1/runs/${run.id}`, (job) => told(controller, job.state), signal);
    if (done.state !== "succeeded") throw new Error(`${controller}: the run ${done.state}${done.problem ? `: ${done.problem.detail || done.problem.title}` : ""}`);
    const found = await read(controller, done, signal);
    told(controller, "read");
    return found;
  }));
}
