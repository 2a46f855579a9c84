// A chart that follows its box, and how wide its words are.

export function sized(host, draw) {
  // Draw a chart as wide as its box, again whenever the box changes; returns a function that draws it anew.
  let width = 0;
  const again = () => width && host.replaceChildren(draw(width));
  new ResizeObserver(([entry]) => {
    const wide = Math.floor(entry.contentRect.width);
    if (wide === width) return;
    width = wide;
    again();
  }).observe(host);
  return again;
}

const ruler = document.createElement("canvas").getContext("2d");

export function textWidth(text, weight = 400) {
  ruler.font = `${weight} 12px ${getComputedStyle(document.body).fontFamily}`;
  return ruler.measureText(text).width;
}
