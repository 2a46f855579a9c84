// What the address says behind the view's path: #/live/demo?from=0&to=600. A reload, or whoever is sent it, sees the same.

function split() {
  const [path, query = ""] = location.hash.split("?");
  return [path, new URLSearchParams(query)];
}

function decoded(part) {
  // What is no escape stands for itself, and names nothing.
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

export const path = () => split()[0].replace(/^#\/?/, "").split("/").map(decoded);

export const remembered = (name) => split()[1].get(name);

export function remember(changes) {
  // Write what is shown into the address; null takes a name out. It makes no new entry in the browser's history.
  const [path_, query] = split();
  for (const [name, value] of Object.entries(changes)) {
    if (value === null || value === "") query.delete(name);
    else query.set(name, value);
  }
  const text = query.toString();
  const hash = `${path_ || "#/live"}${text ? `?${text}` : ""}`;
  if (hash !== location.hash) history.replaceState(history.state, "", hash);
}
