// Every twin with its state, and the form that starts one more.
import { remember, remembered } from "../lib/address.js";
import { repeated } from "../lib/age.js";
import { ask, listed, post } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { h, s, set, toast } from "../lib/dom.js";
import { clock, number } from "../lib/format.js";
import { List } from "../lib/list.js";
import { countWords } from "./alarms.js";
import { Readings } from "./measured.js";
import { ALIVE, LETTER, STATES, TANKS, isMeasured, speedWords } from "./names.js";
import { startForm } from "./start.js";
import { twinTable } from "./twin_table.js";

const EVERY = 2000; // the list is asked for anew [ms]
const HIGHEST = 1000; // of the small columns [bar]

const stateTag = (state) => h("span", { class: `tag ${STATES[state] ?? ""}` }, state);

const SERVICE = {
  certified: "a verified certificate of service belongs to its controller and its station",
  uncertified: "no verified certificate of service belongs to its controller and its station",
};

const serviceTag = (service) => h("span", { class: `tag service ${service === "certified" ? "good" : ""}`, title: SERVICE[service] }, service);

const SOURCE = { simulated: "its seconds are simulated", measured: "its seconds are those of a real station, as measured", replay: "its seconds are those that another twin told" };

const sourceTag = (source) => h("span", { class: `tag source ${source}`, title: SOURCE[source] }, source);

const alarmTag = (counts) => h("span", { class: `tag priority ${counts.highest}`, title: `${counts.unacknowledged} not acknowledged` }, countWords(counts));

export const tagsOf = ({ state, source, service, alarms }) =>
  // A certificate is one of a controller, which a measured twin and a replay have not.
  [stateTag(state), " ", sourceTag(source), ...(source === "simulated" ? [" ", serviceTag(service)] : []), ...(alarms?.announced ? [" ", alarmTag(alarms)] : [])];

const factsOf = ({ source, scenario, station, controller, speed, of }) => // what a twin is, in a line
  ({ simulated: [scenario, station, controller, speedWords(speed)], measured: [scenario, station], replay: [`plays ${of}`, station, speedWords(speed)] })[source].join(" · ");

class Card {
  constructor(twin, renew) {
    this.readings = new Readings(); // of a measured twin
    this.tags = h("p", { class: "tags" });
    this.facts = h("p", { class: "facts" });
    this.now = h("p", { class: "now" });
    this.columns = TANKS.map((tank) => s("rect", { class: tank, width: 14, rx: 2 }));
    const picture = s("svg", { class: "mini", viewBox: "0 0 84 52", "aria-hidden": "true" },
      this.columns.map((column, place) => [s("rect", { class: "back", x: place * 22, y: 0, width: 14, height: 36, rx: 2 }), column, s("text", { x: place * 22 + 7, y: 50, "text-anchor": "middle" }, LETTER[TANKS[place]])]));
    this.columns.forEach((column, place) => column.setAttribute("x", place * 22));
    this.end = h("button", { type: "button", class: "danger", onclick: () => this.#end(renew) }, "Stop");
    this.element = h("li", { class: "card twin-card" }, h("div", { class: "head" }, h("h2", {}, h("a", { href: `#/live/${twin.id}` }, twin.id)), this.tags),
      h("div", { class: "body" }, picture, h("div", {}, this.facts, this.now)), h("div", { class: "actions" }, h("a", { class: "button", href: `#/live/${twin.id}`, "aria-label": `Open ${twin.id}` }, "Open"), this.end));
    this.show(twin);
  }

  show(twin) {
    this.twin = twin;
    const alive = ALIVE.has(twin.state);
    const said = `${twin.state} ${twin.service} ${JSON.stringify(twin.alarms)}`;
    if (this.tags.dataset.said !== said) this.tags.replaceChildren(...tagsOf(twin));
    this.tags.dataset.said = said;
    const measured = isMeasured(twin);
    set(this.facts, factsOf(twin));
    if (measured && twin.values) this.readings.take(twin.values);
    const values = measured && twin.values ? this.readings.picture(twin.values) : twin.values;
    const waiting = measured ? "" : `, ${values?.queue_length} waiting`;
    const served = values && (values.vehicle >= 0 ? `vehicle ${values.vehicle} at the dispenser${waiting}` : "no vehicle");
    set(this.now, values ? `${clock(values.time)} · ${served}` : measured ? "no measurements followed yet" : `${number(twin.samples)} samples told`);
    TANKS.forEach((tank, place) => {
      const height = Math.round((36 * Math.min(values?.[`pressure_${tank}`] ?? 0, HIGHEST)) / HIGHEST);
      this.columns[place].setAttribute("y", 36 - height);
      this.columns[place].setAttribute("height", height);
    });
    set(this.end, alive ? "Stop" : "Forget");
    this.end.setAttribute("aria-label", `${alive ? "Stop" : "Forget"} ${twin.id}`);
  }

  async #end(renew) {
    const { id, state } = this.twin;
    const alive = ALIVE.has(state);
    const text = alive ? "It ends for good; what it told stays." : "What it told is removed with it.";
    if (!(await confirmed(`${alive ? "Stop" : "Forget"} ${id}?`, text, alive ? "Stop it" : "Forget it"))) return;
    try {
      if (alive) await post(`/v1/twins/${id}/stop`);
      else await ask(`/v1/twins/${id}`, { method: "DELETE" });
      await renew();
    } catch (error) {
      toast(error.message, "problem");
    }
  }
}

export async function showTwins(root, signal) {
  const empty = h("div", { class: "empty", hidden: true }, h("h2", {}, "No twin runs here yet"),
    h("p", {}, "A twin is a hydrogen refueling station that runs on the clock, second by second, with a controller in its seat. Start one below and watch it."));
  const place = h("section", { class: "card", "aria-label": "Start a twin" }, h("h2", {}, "Start a twin"));
  const found = {
    label: "twins", empty, kind: ({ state }) => state,
    text: (twin) => [twin.id, twin.state, twin.source, twin.scenario, factsOf(twin)].join(" "),
  };
  const lists = {
    cards: new List({ ...found, className: "twins", each: 9, line: (twin) => new Card(twin, renew) }),
    table: twinTable({ ...found, empty: h("div", {}), each: 50 }),
  };
  let shown = remembered("as") === "table" ? "table" : "cards";
  const as = (name, text) => h("button", { type: "button", "aria-pressed": String(name === shown), onclick: () => choose(name) }, text);
  const choices = { cards: as("cards", "Cards"), table: as("table", "Table") };
  const holder = h("div", {});
  const choose = (name) => {
    // One of the two is in the page; what is searched for goes with the choice.
    lists[name].find.value = lists[shown].find.value;
    shown = name;
    remember({ as: name === "table" ? name : null });
    for (const [each, button] of Object.entries(choices)) button.setAttribute("aria-pressed", String(each === name));
    holder.replaceChildren(lists[name].element);
    lists[name].again();
  };
  const reach = () => {
    place.scrollIntoView({ block: "start" });
    place.querySelector("input")?.focus({ preventScroll: true });
  };

  async function renew() {
    const items = await listed("/v1/twins", { signal });
    for (const list of Object.values(lists)) list.show(items);
    return items;
  }

  const items = await repeated(EVERY, renew, signal);
  holder.replaceChildren(lists[shown].element);
  place.append(await startForm(items, signal));
  root.append(h("div", { class: "head" }, h("h1", {}, "Live twins"), h("div", { class: "group", role: "group", "aria-label": "Shown as" }, choices.cards, choices.table), h("button", { type: "button", onclick: reach }, "Start a twin")), holder, place);
}
