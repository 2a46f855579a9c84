// The tables of a comparison, as `hrs compare` prints them: our figures, and the thesis's below.
import { h, table } from "../lib/dom.js";

export function tables(scenarios) {
  // Its section, and `renew` that shows what has come since; `whole` (a map by scenario) says of how many runs a line ought to be.
  const place = h("div", { class: "stack" });
  const renew = ({ tables: found, verdict }, figures, whole) => {
    const partial = new Map(figures.items.filter(({ scenario, runs }) => runs < whole.get(scenario)).map(({ scenario, controller }) => [`${scenario} ${controller}`, ` of ${whole.get(scenario)}`]));
    place.replaceChildren(...[verdict && h("p", { class: "verdict" }, verdict), ...found.map((each, number) => one(each, scenarios[number], partial))].filter(Boolean));
  };
  const element = h("section", { class: "card tables", "aria-labelledby": "tables-title" },
    h("h2", { id: "tables-title" }, "Tables"),
    h("p", { class: "lead" },
      "Times in seconds; percentages against logic. t_total is the sum of the waits, t_comp the compressor-seconds; restored adds what would bring each buffer back to its initial mass; t_dis is the time with an outlet open."),
    place);
  return { element, renew };
}

function one({ title, headings, rows }, scenario, partial) {
  if (!rows.length) return h("p", { class: "hint" }, h("b", {}, title.replace("  ", " · ")), " no run of it is done yet.");
  const changing = headings.map((_, column) => rows.some((row) => row.cells[column].endsWith("%")));
  let controller = "";
  const cells = rows.map((row) => {
    const goesOn = !row.controller;
    controller = row.controller || controller;
    return [goesOn ? h("span", { class: "unseen" }, controller) : controller, originOf(row, !goesOn && partial.get(`${scenario} ${controller}`)), ...row.cells.map((text, column) => cell(text, changing[column]))];
  });
  const made = table(title.replace("  ", " · "), ["controller", "figures", ...headings], cells, { numeric: (column) => column > 1 });
  made.querySelectorAll("thead th").forEach((heading, column) => heading.classList.toggle("changing", Boolean(changing[column - 2])));
  made.querySelectorAll("tbody tr").forEach((line, place) => {
    if (rows[place].controller) line.classList.add("first");
    if (rows[place].origin === "thesis") line.classList.add("thesis");
  });
  return made;
}

function originOf({ origin }, some) {
  return some ? h("span", { class: "some" }, `${origin}${some}`) : origin;
}

function cell(text, changing) {
  // A figure and, where its column has any, its distance from logic in a column of its own.
  const found = /^(-?[\d ]+)(?: ([+-]\d+) %)?$/.exec(text);
  if (!found && text) return text;
  const [, value = "–", change] = found ?? [];
  return h("span", {}, value.replaceAll(" ", "\u202f"), changing && h("span", { class: "change" }, change && ` ${change.replace("-", "−")}\u202f%`));
}
