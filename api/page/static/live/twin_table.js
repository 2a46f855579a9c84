// Many twins in a table: what each does, how old its data are, what is wrong, who waits, what the day costs; sorted by any column.
import { remember, remembered } from "../lib/address.js";
import { h, set } from "../lib/dom.js";
import { clock, number } from "../lib/format.js";
import { List } from "../lib/list.js";
import { countWords } from "./alarms.js";
import { STATES } from "./names.js";

const URGENCY = { high: 4, medium: 3, low: 2, advisory: 1 };

const alarmRank = ({ alarms }) => (alarms?.announced ? 1000 * URGENCY[alarms.highest] + alarms.announced : 0);
const ageOf = ({ newest_sent: sent, state }) => (sent && state === "running" ? Math.max(0, Date.now() / 1000 - sent) : null);
const queueOf = ({ values }) => values?.queue_length ?? null;

// Heading, what it is sorted by, and what its cell says; a column without unit in its heading has none.
const COLUMNS = [
  ["Twin", ({ id }) => id, ({ id }) => id],
  ["State", ({ state }) => state, ({ state }) => state],
  ["Source", ({ source }) => source, ({ source }) => source],
  ["Station", ({ station }) => station, ({ station }) => station],
  ["Controller", ({ source, controller }) => (source === "simulated" ? controller : ""), ({ source, controller }) => (source === "simulated" ? controller : "–")],
  ["Its clock", ({ values, samples }) => values?.time ?? samples, ({ values, samples }) => clock(values?.time ?? samples)],
  ["Age [s]", ageOf, (twin) => number(ageOf(twin), 1)],
  ["Alarms", alarmRank, ({ alarms }) => (alarms?.announced ? `${countWords(alarms)}, ${alarms.highest}` : alarms ? "none" : "–")],
  ["Queue", queueOf, (twin) => number(queueOf(twin))],
  ["Served today", ({ today }) => today?.vehicles_served ?? null, ({ today }) => number(today?.vehicles_served)],
  ["Mean wait [s]", ({ today }) => today?.wait_mean_s ?? null, ({ today }) => number(today?.wait_mean_s)],
  ["EUR/kg", ({ today }) => today?.eur_per_kg ?? null, ({ today }) => number(today?.eur_per_kg, 2)],
];

const NUMERIC = 5; // from this column on

export function compared(by, falling) {
  // An order of twins by a column; those without a figure come last either way, equal ones as they came.
  const key = COLUMNS[by][1];
  return (one, other) => {
    const [a, b] = [key(one), key(other)];
    if (a === null || b === null) return (a === null) - (b === null);
    const order = typeof a === "string" ? a.localeCompare(b, "en") : a - b;
    return falling ? -order : order;
  };
}

class Row {
  constructor(twin) {
    this.link = h("a", { href: `#/live/${twin.id}` }, twin.id);
    this.cells = COLUMNS.slice(1).map((_, place) => h("td", { class: place + 1 >= NUMERIC ? "number" : null }));
    this.state = h("span", { class: "tag" });
    this.cells[0].append(this.state);
    this.element = h("tr", {}, h("th", { scope: "row" }, this.link), this.cells);
    this.show(twin);
  }

  show(twin) {
    this.state.className = `tag ${STATES[twin.state] ?? ""}`;
    set(this.state, twin.state);
    this.cells.slice(1).forEach((cell, place) => set(cell, COLUMNS[place + 2][2](twin)));
  }
}

export function twinTable(options) {
  let [by, falling] = [Math.max(0, COLUMNS.findIndex(([heading]) => heading === remembered("sort"))), remembered("falling") === "yes"];
  const sorted = remembered("sort") !== null;
  let chosen = sorted; // as long as nobody has chosen, the oldest comes first
  const heads = COLUMNS.map(([heading], place) => h("th", { scope: "col", class: place >= NUMERIC ? "number" : null }, h("button", { type: "button", class: "sort", onclick: () => sort(place) }, heading)));
  const mark = () => heads.forEach((head, place) => head.setAttribute("aria-sort", chosen && place === by ? (falling ? "descending" : "ascending") : "none"));
  const body = h("tbody", {});
  const frame = h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Twins in a table" }, h("table", { class: "twin-table" }, h("caption", {}, "Twins"), h("thead", {}, h("tr", {}, heads)), body));
  const list = new List({ ...options, list: body, frame, line: (twin) => new Row(twin), order: (items) => (chosen ? items.toSorted(compared(by, falling)) : items) });
  function sort(place) {
    // Figures fall at first: what is most urgent stands on top.
    falling = chosen && place === by ? !falling : place >= NUMERIC;
    [by, chosen] = [place, true];
    remember({ sort: COLUMNS[by][0], falling: falling ? "yes" : null });
    mark();
    list.again();
  }
  mark();
  return list;
}
