// What the series of a twin are made of: the columns it tells, its panels, and what stands for a step of the past.
import { SENSED, measuredPanels, whole } from "./measured.js";
import { SHOWN, isMeasured } from "./names.js";
import { PANELS } from "./panels.js";

// `extremes`: a step is its least and its greatest row, so that no peak is lost; `hold`: a second of every half step, so
// that figures of one row belong together.
export const SIMULATED = { columns: SHOWN, panels: PANELS, fold: "extremes", whole: (table) => table };

export const MEASURED = { columns: SENSED, panels: measuredPanels(), fold: "hold", whole };

export const recordOf = (twin) => (isMeasured(twin) ? MEASURED : SIMULATED);
