// Numbers as the field writes them: narrow spaces in thousands, a real minus, units, the station's clock.

const SPACE = "\u202f";

export function number(value, digits = 0) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const [whole, rest] = Math.abs(value).toFixed(digits).split(".");
  const sign = value < 0 && Number(value.toFixed(digits)) !== 0 ? "−" : "";
  return sign + whole.replace(/\B(?=(\d{3})+$)/g, SPACE) + (rest ? `.${rest}` : "");
}

export const quantity = (value, unit, digits = 0) => `${number(value, digits)}${SPACE}${unit}`;

export function clock(seconds) {
  // Time since the station's start: 0:07:35, or 2 d 3:04:05.
  const total = Math.round(seconds);
  const [days, rest] = [Math.floor(total / 86400), total % 86400];
  const two = (value) => String(value).padStart(2, "0");
  const time = `${Math.floor(rest / 3600)}:${two(Math.floor(rest / 60) % 60)}:${two(rest % 60)}`;
  return days ? `${days}${SPACE}d ${time}` : time;
}

export const words = (name) => name.replaceAll("_", " ");

export const when = (iso) => (iso ? new Date(iso).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "medium" }) : "–");
