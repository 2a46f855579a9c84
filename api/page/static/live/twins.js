// Every twin with its state, and the form that starts one more.
import { repeated } from "../lib/age.js";
import { ask, listed, post } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { h, s, set, toast } from "../lib/dom.js";
import { clock, number } from "../lib/format.js";
import { List } from "../lib/list.js";
import { ALIVE, LETTER, STATES, TANKS, speedWords } from "./names.js";
import { startForm } from "./start.js";

const EVERY = 2000; // the list is asked for anew [ms]
const HIGHEST = 1000; // of the small columns [bar]

export const stateTag = (state) => h("span", { class: `tag ${STATES[state] ?? ""}` }, state);

const SERVICE = {
  certified: "a verified certificate of service belongs to its controller and its station",
  uncertified: "no verified certificate of service belongs to its controller and its station",
};

export const serviceTag = (service) => h("span", { class: `tag service ${service === "certified" ? "good" : ""}`, title: SERVICE[service] }, service);

class Card {
  constructor(twin, renew) {
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
    const said = `${twin.state} ${twin.service}`;
    if (this.tags.dataset.said !== said) this.tags.replaceChildren(stateTag(twin.state), " ", serviceTag(twin.service));
    this.tags.dataset.said = said;
    set(this.facts, `${twin.scenario} · ${twin.station} · ${twin.controller} · ${speedWords(twin.speed)}`);
    const values = twin.values;
    const served = values && (values.vehicle >= 0 ? `vehicle ${values.vehicle} at the dispenser, ${values.queue_length} waiting` : "no vehicle");
    set(this.now, values ? `${clock(values.time)} · ${served}` : `${number(twin.samples)} samples told`);
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
  const list = new List({
    label: "twins", className: "twins", each: 9, empty, line: (twin) => new Card(twin, renew), kind: ({ state }) => state,
    text: ({ id, state, scenario, station, controller }) => [id, state, scenario, station, controller].join(" "),
  });
  const reach = () => {
    place.scrollIntoView({ block: "start" });
    place.querySelector("input")?.focus({ preventScroll: true });
  };

  async function renew() {
    const items = await listed("/v1/twins", { signal });
    list.show(items);
    return items;
  }

  const items = await repeated(EVERY, renew, signal);
  place.append(await startForm(items, signal));
  root.append(h("div", { class: "head" }, h("h1", {}, "Live twins"), h("button", { type: "button", onclick: reach }, "Start a twin")), list.element, place);
}
