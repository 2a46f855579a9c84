// The shell: which view is shown, how old it is, and whether the service answers.
import { path } from "./lib/address.js";
import { age } from "./lib/age.js";
import { connection, passing } from "./lib/api.js";
import { h, set } from "./lib/dom.js";
import { speak } from "./lib/speak.js";

const AGAIN = 1000; // a view that could not be shown is tried again [ms]

// Each view exports `show(root, parts)`: it fills `root` for the rest of the address and returns a function that ends it.
const VIEWS = {
  live: () => import("./live/view.js"),
  compare: () => import("./compare/view.js"),
  certificates: () => import("./certificates/view.js"),
  scenarios: () => import("./scenarios/view.js"),
};

const root = document.getElementById("view");
let close = () => {};
let turn = 0;

function address() {
  const [name, ...parts] = path();
  return name in VIEWS ? { name, parts } : { name: "live", parts: [] };
}

async function navigate(event) {
  if (location.hash && !location.hash.startsWith("#/")) return; // a place in the page, not a view
  const { name, parts } = address();
  const mine = ++turn;
  close();
  close = () => {};
  age.clear();
  for (const link of document.querySelectorAll("header nav a")) {
    if (link.hash === `#/${name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  const place = h("div", { class: `view ${name}` });
  const loading = h("p", { class: "lead", role: "status" }, "loading …");
  root.replaceChildren(place);
  const slow = setTimeout(() => place.before(loading), 400);
  document.title = `${name[0].toUpperCase()}${name.slice(1)} · hrs-twin`;
  if (event) root.focus({ preventScroll: true });
  try {
    const view = await VIEWS[name]();
    if (mine !== turn) return;
    const end = await view.show(place, parts);
    if (mine === turn) close = end ?? close;
    else end?.();
  } catch (error) {
    if (mine !== turn) return;
    place.replaceChildren(h("p", { class: "problem", role: "alert" }, error.message));
    if (passing(error)) setTimeout(() => mine === turn && navigate(), AGAIN);
  } finally {
    clearTimeout(slow);
    loading.remove();
  }
}

const [status, dated] = ["connection", "age"].map((id) => document.getElementById(id));

function tell() {
  const { lost, unconfirmed } = connection;
  const state = lost ? "connection lost, trying again" : age.stale ? "no news, what is shown is old" : age.service.known ? "connected" : "connecting";
  const said = [state, unconfirmed && `${unconfirmed} command${unconfirmed === 1 ? "" : "s"} not confirmed`].filter(Boolean).join(", ");
  if (status.textContent !== said && status.textContent !== "connecting") speak(said);
  set(status, said);
  status.classList.toggle("lost", lost || age.stale || unconfirmed > 0);
  document.documentElement.classList.toggle("stale", age.stale);
}

for (const each of [connection, age]) each.addEventListener("change", tell);
age.addEventListener("tick", () => {
  set(dated, age.words);
  if (dated.dataset.day !== age.day) dated.dataset.day = age.day; // for a print
  if (status.textContent === "connecting") tell();
});
window.addEventListener("hashchange", navigate);
age.watch();
connection.watch();
tell();
navigate();
