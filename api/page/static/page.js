// The page: one live twin by server-sent events, the jobs by polling. No framework, nothing from elsewhere.
const TANKS = ["high", "medium", "low", "vehicle"];
const SPAN = 600; // seconds of the chart
const at = (id) => document.getElementById(id);
const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
const state = { twin: null, samples: [], events: [], abort: null, paused: false };
let key = sessionStorage.getItem("hrs-key");

async function ask(path, options = {}) {
  const headers = { ...(options.body ? { "content-type": "application/json" } : {}), ...(key ? { authorization: `Bearer ${key}` } : {}) };
  const answer = await fetch(path, { ...options, headers });
  if (answer.status === 401) {
    key = window.prompt("This service asks for a key") || "";
    sessionStorage.setItem("hrs-key", key);
    if (key) return ask(path, options);
  }
  if (!answer.ok) {
    const problem = await answer.json();
    throw new Error([problem.title, problem.detail, ...(problem.errors || []).map((e) => `${e.field}: ${e.message}`)].filter(Boolean).join(" – "));
  }
  return options.stream ? answer : answer.json();
}

function say(text, lost = false) {
  at("status").textContent = text;
  at("status").classList.toggle("lost", lost);
}

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

function cell(row, text, className) {
  row.append(element("td", text, className));
}

function drawTanks(values) {
  const rows = TANKS.map((tank) => {
    const row = document.createElement("tr");
    cell(row, tank);
    cell(row, number(values[`pressure_${tank}`], 1));
    cell(row, number(values[`temperature_${tank}`], 1));
    const mass = values[`mass_${tank}`];
    cell(row, number(mass === null ? null : mass / 1000, 2));
    for (const side of ["inlet", "outlet"]) {
      const open = values[`${side}_${tank}`];
      cell(row, open === undefined ? "" : open ? "open" : "closed", open ? "open" : "closed");
    }
    return row;
  });
  at("tanks").tBodies[0].replaceChildren(...rows);
  const vehicle = values.vehicle < 0 ? "no vehicle" : `vehicle ${values.vehicle}`;
  at("about").textContent = `Simulated time ${Math.round(values.time).toLocaleString("en").replaceAll(",", " ")} s · ${vehicle} at the dispenser, ${values.queue_length} waiting · compressor ${number(values.flow_compressor, 1)} g/s · dispenser ${number(values.flow_dispenser, 1)} g/s`;
}

function svg(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [attribute, value] of Object.entries(attributes)) made.setAttribute(attribute, value);
  if (text) made.textContent = text;
  return made;
}

function drawChart() {
  const [left, right, top, bottom] = [40, 615, 10, 195];
  const last = state.samples.at(-1)?.time ?? 0;
  const x = (time) => right - ((last - time) / SPAN) * (right - left);
  const y = (pressure) => bottom - (pressure / 1000) * (bottom - top);
  const parts = [];
  for (const pressure of [0, 250, 500, 750, 1000]) {
    parts.push(svg("line", { x1: left, x2: right, y1: y(pressure), y2: y(pressure) }));
    parts.push(svg("text", { x: left - 6, y: y(pressure) + 4, "text-anchor": "end" }, String(pressure)));
  }
  for (const back of [0, 150, 300, 450, 600]) {
    parts.push(svg("text", { x: x(last - back), y: bottom + 16, "text-anchor": "middle" }, back ? `−${back} s` : "now"));
  }
  for (const tank of TANKS) {
    let run = [];
    const finish = () => {
      if (run.length > 1) parts.push(svg("polyline", { class: tank, points: run.join(" ") }));
      run = [];
    };
    for (const sample of state.samples) {
      const pressure = sample[`pressure_${tank}`];
      if (pressure === null) finish();
      else run.push(`${x(sample.time).toFixed(1)},${y(pressure).toFixed(1)}`);
    }
    finish();
  }
  at("chart").replaceChildren(...parts);
}

function drawEvents() {
  const items = state.events.slice(-60).reverse().map((event) => {
    const item = document.createElement("li");
    const details = Object.entries(event.details)
      .filter(([, value]) => value !== null && !(Array.isArray(value) && !value.length))
      .map(([name, value]) => `${name.replaceAll("_", " ")} ${typeof value === "number" ? Number(value.toFixed(1)) : typeof value === "object" && !Array.isArray(value) ? JSON.stringify(value) : String(value).replaceAll(",", " ")}`);
    item.append(element("span", `${Math.round(event.time)} s`), element("span", event.kind.replaceAll("_", " ")), element("span", details.join(", ")));
    return item;
  });
  at("events").replaceChildren(...items);
}

let due = false;
function redraw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    const newest = state.samples.at(-1);
    if (newest) drawTanks(newest);
    drawChart();
    drawEvents();
  });
}

function take(kind, data) {
  if (kind === "sample") {
    const values = JSON.parse(data).values;
    if (state.samples.length && values.time < state.samples.at(-1).time) state.samples = [];
    state.samples.push(values);
    while (state.samples[0].time < values.time - SPAN) state.samples.shift();
  } else if (kind === "event") {
    const event = JSON.parse(data);
    if (!state.events.length || event.seq > state.events.at(-1).seq) state.events.push(event);
    state.events = state.events.slice(-200);
    if (["paused", "continued", "speed_changed", "controller_changed", "stopped", "finished"].includes(event.kind)) showControls();
  }
  redraw();
}

async function past(twin) {
  const { samples } = await ask(`/v1/twins/${twin}`);
  const from = Math.max(0, samples - SPAN);
  const columns = TANKS.map((tank) => `pressure_${tank}`).join(",");
  const table = (await ask(`/v1/twins/${twin}/history?columns=${columns}&from_s=${from}`)).columns;
  const rows = table.time.map((time, row) => Object.fromEntries(Object.entries(table).map(([name, values]) => [name, values[row]])));
  state.samples = rows;
}

async function follow(twin) {
  state.abort?.abort();
  const abort = (state.abort = new AbortController());
  state.twin = twin;
  state.samples = [];
  state.events = [];
  await showControls();
  while (!abort.signal.aborted && state.twin === twin) {
    try {
      await past(twin).catch(() => {});
      const answer = await ask(`/v1/twins/${twin}/stream`, { signal: abort.signal, stream: true });
      say("live");
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        const blocks = text.split("\n\n");
        text = blocks.pop();
        for (const block of blocks) {
          const fields = Object.fromEntries(block.split("\n").map((line) => [line.slice(0, line.indexOf(":")), line.slice(line.indexOf(":") + 2)]));
          if (fields.data) take(fields.event, fields.data);
        }
      }
    } catch (error) {
      if (abort.signal.aborted) return;
      say(`connection lost: ${error.message}; trying again`, true);
    }
    await new Promise((wake) => setTimeout(wake, 1000));
  }
}

async function showControls() {
  const twin = await ask(`/v1/twins/${state.twin}`);
  state.paused = twin.state === "paused";
  at("pause").textContent = state.paused ? "Continue" : "Pause";
  const known = [...at("speed").options].some((option) => option.value === String(twin.speed));
  if (!known) at("speed").append(new Option(`${twin.speed}x`, String(twin.speed)));
  at("speed").value = String(twin.speed);
  if (![...at("controller").options].some((option) => option.value === twin.controller)) at("controller").append(new Option(twin.controller));
  at("controller").value = twin.controller;
  const alive = ["running", "paused"].includes(twin.state);
  for (const id of ["pause", "vehicle", "speed", "controller"]) at(id).disabled = !alive;
}

async function change(body) {
  try {
    await ask(`/v1/twins/${state.twin}`, { method: "PATCH", body: JSON.stringify(body) });
  } catch (error) {
    say(error.message, true);
  }
  await showControls();
}

async function showTwins() {
  const { items } = await ask("/v1/twins");
  const options = items.map((twin) => new Option(`${twin.id} (${twin.state})`, twin.id));
  at("twins").replaceChildren(...options);
  if (!items.length) {
    at("about").textContent = "No twin lives here yet: start one with POST /v1/twins.";
    return;
  }
  const wanted = items.find((twin) => twin.id === state.twin) ?? items.find((twin) => twin.state === "running") ?? items[0];
  at("twins").value = wanted.id;
  if (wanted.id !== state.twin) follow(wanted.id);
}

function table(found) {
  const made = document.createElement("table");
  made.append(element("caption", found.title));
  const head = made.createTHead().insertRow();
  for (const heading of ["controller", "", ...found.headings]) head.append(element("th", heading));
  const body = made.createTBody();
  for (const line of found.rows) {
    const row = body.insertRow();
    for (const text of [line.controller, line.origin, ...line.cells]) cell(row, text);
  }
  return made;
}

async function showResult(job) {
  try {
    if (job.answer) {
      const verdict = job.answer.certified ? "certified" : "not certified";
      at("result").replaceChildren(element("p", `${job.ask}, ${job.constraint} switching: ${verdict}: ${job.answer.claim}`));
      return;
    }
    if (job.runs === undefined) {
      const parts = Object.entries(job.metrics).map(([name, value]) => `${name} ${value === null ? "–" : Number(value.toFixed(2))}`);
      at("result").replaceChildren(element("p", `${job.scenario}, ${job.controller}: ${parts.join(" · ")}`));
      return;
    }
    const found = await ask(`/v1/comparisons/${job.id}/table`);
    at("result").replaceChildren(...found.tables.map(table), element("p", found.verdict));
  } catch (error) {
    say(error.message, true);
  }
}

async function showJobs() {
  const pages = await Promise.all([ask("/v1/runs?limit=10"), ask("/v1/comparisons?limit=10"), ask("/v1/certificates?limit=10")]);
  const jobs = pages.flatMap((page) => page.items).sort((a, b) => (a.created < b.created ? 1 : -1)).slice(0, 12);
  const rows = jobs.map((job) => {
    const row = document.createElement("tr");
    cell(row, new Date(job.created).toLocaleTimeString());
    cell(row, job.state);
    cell(row, job.runs === undefined ? (job.state === "succeeded" ? "1 of 1" : "0 of 1") : `${job.runs_done} of ${job.runs}`);
    cell(row, (job.scenarios ?? [job.scenario ?? job.ask]).join(", "));
    cell(row, (job.controllers ?? [job.controller ?? `${job.constraint} switching`]).join(", "));
    const last = document.createElement("td");
    if (job.state === "succeeded") {
      const button = element("button", "Show");
      button.type = "button";
      button.setAttribute("aria-label", `Show the result of ${job.id}`);
      button.addEventListener("click", () => showResult(job));
      last.append(button);
    } else if (job.problem) last.textContent = job.problem.detail;
    row.append(last);
    return row;
  });
  const focused = document.activeElement?.getAttribute("aria-label");
  at("jobs").tBodies[0].replaceChildren(...rows);
  if (focused) at("jobs").querySelector(`[aria-label="${CSS.escape(focused)}"]`)?.focus();
}

async function main() {
  at("legend").append(...TANKS.map((tank) => element("span", `— ${tank}`, tank)), element("span", "pressure [bar]"));
  at("twins").addEventListener("change", (event) => follow(event.target.value));
  at("speed").addEventListener("change", (event) => change({ speed: event.target.value === "max" ? "max" : Number(event.target.value) }));
  at("controller").addEventListener("change", (event) => change({ controller: event.target.value }));
  at("pause").addEventListener("click", () => change({ paused: !state.paused }));
  at("vehicle").addEventListener("click", async () => {
    try {
      await ask(`/v1/twins/${state.twin}/vehicles`, { method: "POST", body: JSON.stringify({ start_pressure_bar: 120 }) });
    } catch (error) {
      say(error.message, true);
    }
  });
  for (;;) {
    try {
      if (!at("controller").options.length) {
        const found = await ask("/v1/controllers");
        at("controller").replaceChildren(...found.map((controller) => new Option(controller.name)));
      }
      await Promise.all([showTwins(), showJobs()]);
    } catch (error) {
      say(`no answer: ${error.message}; trying again`, true);
    }
    await new Promise((wake) => setTimeout(wake, 2000));
  }
}

main();
