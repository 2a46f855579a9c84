// What a screen reader is told of what changes by itself: the newest words, at most so often.
const REST = 10_000; // [ms]

let last = -REST;
let timer = null;

export function speak(text) {
  clearTimeout(timer);
  timer = setTimeout(() => {
    last = performance.now();
    document.getElementById("spoken").textContent = text;
  }, Math.max(0, last + REST - performance.now()));
}
