// Touch on an axis of time: one finger pans, two zoom about their middle; what lies under them stays under them.

const NEAR = 10; // fingers that are closer count as so far apart [px]

export function touched(element, { shown, edges, look }) {
  // `shown()` is the window [from, to], `edges()` its place in the element [left, right], `look(from, to)` moves it.
  const fingers = new Map();
  let held = null;

  const hand = () => {
    const all = [...fingers.values()].slice(0, 2);
    const x = all.reduce((sum, each) => sum + each.x, 0) / all.length - element.getBoundingClientRect().left;
    const apart = all.length < 2 ? NEAR : Math.max(NEAR, Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y));
    return { x, apart };
  };
  const hold = () => {
    // Whenever a finger comes or goes the rest begin anew.
    held = null;
    if (!fingers.size) return;
    const [[from, to], [left, right], { x, apart }] = [shown(), edges(), hand()];
    held = { apart, length: to - from, time: from + ((x - left) / (right - left)) * (to - from) };
  };
  const moved = () => {
    const [[left, right], { x, apart }] = [edges(), hand()];
    const length = (held.length * held.apart) / apart;
    const from = held.time - ((x - left) / (right - left)) * length;
    look(from, from + length);
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    element.setPointerCapture(event.pointerId);
    hold();
  });
  element.addEventListener("pointermove", (event) => {
    const finger = fingers.get(event.pointerId);
    if (!finger || (finger.x === event.clientX && finger.y === event.clientY)) return;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    element.addEventListener(end, (event) => {
      if (fingers.delete(event.pointerId)) hold();
    });
  }
}
