// The station as a picture: levels, open valves, flows, and the limits that keep a valve closed.
import { h, s, set } from "../lib/dom.js";
import { clock, number, quantity } from "../lib/format.js";
import { NARROW, WIDE } from "./layouts.js";
import { fullAt, levelsOf, nearest } from "./limits.js";
import { BUFFERS, DECISIONS, OWN, TANKS, VALVES, equation, limitOf, titled, valveWords } from "./names.js";
import { carAt, compressorOf, cubeOf, dispenserOf, precoolerOf, streamOf, tankOf, valveOf } from "./symbols.js";

const CARS = 3; // drawn of a queue; the number says the rest

export class Schematic {
  #values = null;

  constructor(scenario, signal, { decided = true } = {}) {
    // `decided`: whether the twin tells who decided, what a limit refused and who waits.
    this.decided = decided;
    this.station = scenario.station;
    this.levels = levelsOf(scenario.station);
    this.place = h("div", { class: "drawing" });
    this.clock = h("span", { class: "clock", "data-value": "time" }, "–");
    this.decision = h("p", { class: "decision", hidden: !decided });
    this.reasons = h("ul", { class: "reasons", hidden: !decided });
    this.margins = h("dl", { class: "margins", "aria-label": "Margins to the limits" });
    this.own = h("dl", { class: "own", "aria-label": "Figures of the plant", hidden: true });
    this.staleness = h("p", { class: "tag warn", hidden: true });
    this.moment = h("strong", { class: "moment" }, "at the cursor · ");
    this.element = h("section", { class: "card schematic", "aria-label": "Station" },
      h("div", { class: "head" }, h("h2", {}, "Station"), this.staleness, h("p", { class: "time" }, this.moment, h("span", {}, "station's clock "), this.clock)),
      this.place, (this.below = h("div", { class: "below" }, this.decision, this.reasons, this.margins, this.own)));
    const narrow = matchMedia("screen and (max-width: 1000px)");
    const draw = () => this.#draw(narrow.matches ? NARROW : WIDE);
    narrow.addEventListener("change", draw, { signal });
    draw();
  }

  #draw(layout) {
    const pipe = (d, kind) => s("path", { class: `pipe ${kind}`, d });
    const all = [layout.supply, ...layout.into, ...layout.out, layout.cooled, layout.hose];
    this.streams = {
      supply: streamOf(layout.supply, "compressor"),
      ...Object.fromEntries(BUFFERS.flatMap((buffer, row) => [[`inlet_${buffer}`, streamOf(layout.into[row], buffer)], [`outlet_${buffer}`, streamOf(layout.out[row], buffer)]])),
      cooled: streamOf(layout.cooled, "dispenser"),
      hose: streamOf(layout.hose, "dispenser"),
    };
    this.tanks = Object.fromEntries(TANKS.map((tank) => [tank, tankOf(titled(tank), tank === "vehicle" ? layout.vehicle : layout.buffers[BUFFERS.indexOf(tank)], tank, this.#marks(tank))]));
    this.valves = Object.fromEntries(VALVES.map((valve) => [valve, valveOf(valve, layout[`${valve.split("_")[0]}s`][BUFFERS.indexOf(valve.split("_")[1])])]));
    this.compressor = compressorOf(layout.compressor);
    this.precooler = precoolerOf(layout.precooler);
    this.dispenser = dispenserOf(layout.dispenser);
    const { x, y } = layout.queue;
    this.queue = s("text", { x, y: y + 20, class: "figure", "data-value": "queue_length" }, "–");
    this.cars = Array.from({ length: CARS }, (none, place) => carAt(x + place * 42, y));
    for (const [tank, { parts }] of Object.entries(this.tanks)) for (const kind of ["pressure", "temperature", "mass"]) parts[kind].dataset.value = `${kind}_${tank}`;
    const [width, height] = layout.size;
    this.narrow = layout === NARROW;
    this.place.replaceChildren(s("svg", { viewBox: `0 0 ${width} ${height}`, class: layout.name, role: "group", "aria-label": "Schematic of the station" },
      all.map((d) => pipe(d, "")), Object.values(this.streams), cubeOf(layout.cube), this.compressor.element, Object.values(this.tanks).map(({ element }) => element),
      Object.values(this.valves).map(({ element }) => element), this.precooler.element, this.dispenser.element, this.cars, this.queue));
    this.below.style.minHeight = "";
    if (this.#values) this.show(this.#values);
  }

  stale(stale, newest) {
    // The newest second that is known was told before the connection was lost.
    this.element.classList.toggle("stale", stale);
    this.staleness.hidden = !stale;
    if (stale) set(this.staleness, newest === undefined ? "stale" : `stale: as of ${clock(newest)}`);
  }

  past(past) {
    // What is shown is a second of the past, that under the cursor.
    this.#keep();
    this.element.classList.toggle("past", past);
  }

  #keep() {
    // What is pointed at, below, stays where it is on the screen: were it to move, the cursor would be elsewhere.
    const before = parseFloat(this.below.style.minHeight) || this.below.offsetHeight;
    const height = Math.max(this.below.offsetHeight, before);
    this.below.style.minHeight = `${height}px`;
    if (height > before) scrollBy({ top: height - before, behavior: "instant" });
  }

  rest(resting) {
    this.element.classList.toggle("resting", resting);
  }

  show(values) {
    this.#values = values;
    set(this.clock, clock(values.time));
    for (const tank of TANKS) this.#tank(tank, values);
    for (const valve of VALVES) this.#valve(valve, values);
    const working = BUFFERS.filter((buffer) => values[`inlet_${buffer}`]).length;
    const giving = BUFFERS.some((buffer) => values[`outlet_${buffer}`]);
    set(this.compressor.parts.flow, quantity(values.flow_compressor, "g/s", 1));
    set(this.compressor.parts.work, `${working} of ${this.station.compressor.count} at work`);
    set(this.dispenser.flow, quantity(values.flow_dispenser, "g/s", 1));
    set(this.precooler.said, giving ? "cooling" : "off");
    this.#runs("supply", values.flow_compressor > 0);
    this.#runs("cooled", giving);
    this.#runs("hose", giving);
    set(this.queue, !this.decided ? "" : values.queue_length ? `${values.queue_length} waiting` : "nobody waiting");
    this.cars.forEach((car, place) => car.classList.toggle("here", place < values.queue_length));
    if (this.decided) this.#decide(values);
    this.#margin(values);
    this.#plant(values);
    if (this.element.classList.contains("past")) this.#keep();
  }

  #plant(values) {
    // What only some plants tell; no vehicle has no state of charge.
    const there = OWN.filter(([column]) => column in values);
    this.own.hidden = !there.length;
    if (this.own.children.length !== there.length) this.own.replaceChildren(...there.map(([column, name]) => h("div", {}, h("dt", {}, name), h("dd", { "data-value": column }))));
    this.own.querySelectorAll("dd").forEach((place, row) => {
      const [column, , unit, digits, factor] = there[row];
      set(place, values[column] === null ? "–" : quantity(factor * values[column], unit, digits));
    });
  }

  #margin(values) {
    // Rows stand as long as their names do, so that only figures change.
    const found = nearest(this.levels, values, this.station);
    const names = String(found.map(([name]) => name));
    if (this.margins.dataset.names !== names) this.margins.replaceChildren(...found.map(([name]) => h("div", {}, h("dt", {}, name), h("dd"))));
    this.margins.dataset.names = names;
    this.margins.querySelectorAll("dd").forEach((place, row) => set(place, found[row][1]));
  }

  #marks(tank) {
    // Limits drawn on a tank, as shares of its height.
    if (tank === "vehicle" || this.station.real_gas) return [];
    return [{ share: this.station.compressor.hold_pressure_bar / fullAt(this.station, tank), name: "hold pressure (7.16)" }];
  }

  #runs(name, running) {
    this.streams[name].classList.toggle("running", running);
  }

  #tank(tank, values) {
    const { parts, fill, element } = this.tanks[tank];
    const pressure = values[`pressure_${tank}`];
    const none = pressure === null || pressure === undefined;
    const most = fullAt(this.station, tank);
    fill(none ? 0 : pressure / most);
    element.classList.toggle("none", none);
    set(parts.share, none ? "" : `${number((100 * pressure) / most)}\u202f%`);
    set(parts.pressure, none ? "–" : quantity(pressure, "bar", 1));
    const temperature = values[`temperature_${tank}`];
    set(parts.temperature, none ? "–" : quantity(temperature, "°C", 1));
    set(parts.mass, none || !Number.isFinite(values[`mass_${tank}`]) ? "–" : quantity(values[`mass_${tank}`] / 1000, "kg", 2));
    if (tank === "vehicle") set(parts.name, none && !(values.vehicle >= 0) ? "No vehicle" : `Vehicle ${values.vehicle}`);
  }

  #valve(valve, values) {
    const open = Boolean(values[valve]);
    const limit = limitOf(values[`refused_${valve}`]);
    const side = valve.split("_")[0];
    this.#runs(valve, open);
    const state = open ? "open" : limit ? "refused" : "closed";
    const reason = limit ? `${limit.title}${limit.equation ? ` (${limit.equation})` : ""}` : "";
    this.valves[valve].show(open, this.narrow ? `${side} ${state}` : state, reason);
  }

  #decide(values) {
    // A cost is in its controller's own unit, so what can be said of all is how far the best may lie below.
    const { decision_cost: cost, decision_bound: bound, decision_status: status } = values;
    const share = cost > 0 && bound !== null && bound !== undefined ? (100 * (cost - bound)) / cost : 0;
    const gap = share >= 0.05 ? `, and none costs over ${quantity(share, "%", 1)} less` : "";
    set(this.decision, `Command decided ${DECISIONS[status] ?? "–"}${gap}`);
    const found = VALVES.filter((valve) => values[`refused_${valve}`]).map((valve) => {
      const limit = limitOf(values[`refused_${valve}`]);
      return `${titled(valveWords(valve))} refused, ${equation(limit)}: ${limit.says}.`;
    });
    const said = found.join("");
    if (this.reasons.dataset.said === said) return;
    this.reasons.dataset.said = said;
    this.reasons.replaceChildren(...(found.length ? found : ["No valve is refused."]).map((sentence) => h("li", { class: found.length ? null : "none" }, sentence)));
  }
}
