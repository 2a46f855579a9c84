// The strip below the series: which valves are open, which a limit refuses, the vehicle and the queue.
import { LIMITS, VALVES, equation, valveWords } from "./names.js";

const short = (valve) => valve.replace("inlet_", "in ").replace("outlet_", "out ").replace("high", "H").replace("medium", "M").replace("low", "L");

export function rowsOf(at) {
  // The strip's rows of a table; `at` says in which column a figure stands, if it does.
  return [
    ...VALVES.map((valve) => ({ label: short(valve), column: at(valve), refused: at(`refused_${valve}`), colour: `--${valve.split("_")[1]}`, valve })),
    { label: "vehicle", column: at("vehicle"), colour: "--vehicle" },
    { label: "queue", column: at("queue_length"), colour: "--dispenser" },
  ].filter(({ column }) => column);
}

function runs(times, values, first, last, draw) {
  // Stretches of one value; each row holds until the next.
  for (let row = first; row <= last; ) {
    const begin = row;
    const value = values[row];
    while (row <= last && values[row] === value) row++;
    if (value !== null && value !== undefined) draw(value, times[begin], times[Math.min(row, times.length - 1)]);
  }
}

export function paintStrip(u, colour, rows) {
  const table = u.table;
  if (!table?.[0].length) return;
  const { ctx, bbox } = u;
  const [first, last] = u.series[0].idxs ?? [0, -1];
  const height = bbox.height / rows.length;
  const x = (time) => Math.min(Math.max(u.valToPos(time, "x", true), bbox.left), bbox.left + bbox.width);
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.textBaseline = "middle";
  ctx.textAlign = "left";
  ctx.font = `bold ${11 * ratio}px system-ui, sans-serif`;
  rows.forEach((row, place) => {
    const top = bbox.top + place * height;
    ctx.fillStyle = colour("--line");
    ctx.fillRect(bbox.left, top + height - 1, bbox.width, 1);
    const values = table[row.column];
    const box = (from, to, share = 0.62, low = 0.16) => ctx.fillRect(x(from), top + height * (1 - low - share), Math.max(x(to) - x(from), 1), height * share);
    if (row.valve) {
      ctx.fillStyle = colour(row.colour);
      runs(table[0], values, first, last, (open, from, to) => open && box(from, to));
      ctx.fillStyle = colour("--bad");
      if (row.refused) runs(table[0], table[row.refused], first, last, (code, from, to) => code && box(from, to, 0.16, 0.06));
    } else if (row.label === "vehicle") {
      runs(table[0], values, first, last, (vehicle, from, to) => {
        if (vehicle < 0) return;
        ctx.fillStyle = colour(row.colour);
        ctx.globalAlpha = 0.3;
        box(from, to);
        ctx.globalAlpha = 1;
        const room = x(to) - x(from);
        if (room > 4 * ratio) ctx.fillRect(x(from), top + height * 0.22, 2 * ratio, height * 0.62);
        if (room > 26 * ratio) {
          ctx.fillStyle = colour("--ink");
          ctx.fillText(String(vehicle), x(from) + 6 * ratio, top + height * 0.54);
        }
      });
    } else {
      const most = Math.max(3, ...values.slice(first, last + 1).filter(Number.isFinite));
      ctx.fillStyle = colour(row.colour);
      runs(table[0], values, first, last, (queue, from, to) => queue > 0 && box(from, to, (0.8 * queue) / most, 0.08));
    }
  });
  ctx.restore();
}

export function stripWords(table, row, rows) {
  // What the strip says at a row, in words.
  const valves = rows.filter(({ valve }) => valve);
  const open = valves.filter(({ column }) => table[column][row]).map(({ valve }) => valveWords(valve));
  const limited = valves.filter(({ refused }) => refused);
  const refused = limited.filter((each) => table[each.refused][row]).map((each) => {
    const limit = LIMITS[table[each.refused][row]];
    return `${valveWords(each.valve)}: ${limit.title}, ${equation(limit)}`;
  });
  const of = (label) => rows.find((each) => each.label === label);
  const vehicle = table[of("vehicle").column][row];
  return [
    ["open", open.join(", ") || "none"],
    ...(limited.length ? [["refused", refused.join("; ") || "none"]] : []),
    ["vehicle", vehicle === null || vehicle === undefined || vehicle < 0 ? "none" : String(vehicle)],
    ...(of("queue") ? [["waiting", String(table[of("queue").column][row] ?? "–")]] : []),
  ];
}
