// The shell: which view is shown, and whether the service answers.
import { connection } from "./lib/api.js";
import { h } from "./lib/dom.js";

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
  const [name, ...parts] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  return name in VIEWS ? { name, parts } : { name: "live", parts: [] };
}

async function navigate(event) {
  if (location.hash && !location.hash.startsWith("#/")) return; // a place in the page, not a view
  const { name, parts } = address();
  const mine = ++turn;
  close();
  close = () => {};
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
    if (mine === turn) place.replaceChildren(h("p", { class: "problem", role: "alert" }, error.message));
  } finally {
    clearTimeout(slow);
    loading.remove();
  }
}

const status = document.getElementById("connection");
connection.addEventListener("change", () => {
  status.textContent = connection.lost ? "connection lost, trying again" : "connected";
  status.classList.toggle("lost", connection.lost);
});

window.addEventListener("hashchange", navigate);
connection.watch();
navigate();
