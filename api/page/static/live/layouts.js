// Where the parts of the schematic stand, on a wide and on a narrow page, and how the pipes run between them.
const rows = (tops, make) => tops.map(make);

const WIDE_ROWS = [64, 184, 304];

export const WIDE = {
  name: "wide",
  size: [1200, 364],
  cube: { x: 6, y: 140, w: 108, h: 88 },
  compressor: { x: 200, y: 184, r: 34, words: { x: 200, y: 240, anchor: "middle" } },
  buffers: rows(WIDE_ROWS, (y) => ({ x: 430, y: y - 48, w: 212, h: 96 })),
  inlets: rows(WIDE_ROWS, (y) => ({ x: 356, y, words: { x: 356, y: y + 27, anchor: "middle" } })),
  outlets: rows(WIDE_ROWS, (y) => ({ x: 716, y, words: { x: 716, y: y + 27, anchor: "middle" } })),
  precooler: { x: 816, y: 150, w: 68, h: 68 },
  dispenser: { x: 924, y: 142, w: 90, h: 84 },
  vehicle: { x: 1056, y: 122, w: 138, h: 124 },
  queue: { x: 1062, y: 292 },
  supply: "M108 184 H166",
  into: rows(WIDE_ROWS, (y) => `M234 184 H282 V${y} H430`),
  out: rows(WIDE_ROWS, (y) => `M642 ${y} H788 V184 H816`),
  cooled: "M884 184 H924",
  hose: "M1014 184 H1056",
};

const NARROW_ROWS = [164, 312, 460];

export const NARROW = {
  name: "narrow",
  size: [340, 760],
  cube: { x: 4, y: 6, w: 108, h: 82 },
  compressor: { x: 178, y: 48, r: 30, words: { x: 220, y: 38, anchor: "start" } },
  buffers: rows(NARROW_ROWS, (y) => ({ x: 78, y: y - 48, w: 184, h: 96 })),
  inlets: rows(NARROW_ROWS, (y) => ({ x: 46, y, words: { x: 26, y: y + 66, anchor: "start" } })),
  outlets: rows(NARROW_ROWS, (y) => ({ x: 294, y, words: { x: 314, y: y + 66, anchor: "end" } })),
  precooler: { x: 272, y: 582, w: 60, h: 60 },
  dispenser: { x: 166, y: 570, w: 84, h: 84 },
  vehicle: { x: 4, y: 550, w: 138, h: 124 },
  queue: { x: 8, y: 712 },
  supply: "M106 48 H148",
  into: rows(NARROW_ROWS, (y) => `M178 78 V98 H14 V${y} H78`),
  out: rows(NARROW_ROWS, (y) => `M262 ${y} H326 V582`),
  cooled: "M272 612 H250",
  hose: "M166 612 H142",
};
