// How old what is shown is: the service's clock against the browser's, and until when each source of a view was heard.

export const STALE = 4000; // what is older is shown as past [ms]
const TOLD = 2000; // from this age on it is told in seconds [ms]
const TICK = 250;

class ServiceClock {
  // The service's Unix time less the browser's lies between two bounds: a message came after it was sent, and was sent
  // after it was asked for. Either clock may be set, and a machine may sleep: what contradicts the bounds replaces them.
  #low = -Infinity; // [ms]
  #high = Infinity;

  heard(sent, asked = -Infinity) {
    // The time that a message carries, and when it was asked for.
    const [low, high] = [sent - Date.now(), sent - asked];
    const fits = low <= this.#high && high >= this.#low;
    [this.#low, this.#high] = fits ? [Math.max(low, this.#low), Math.min(high, this.#high)] : [low, high];
  }

  here(sent) {
    // A time of the service on the browser's clock: as early as it can have been, so that nothing is shown too young.
    const offset = this.#high === Infinity ? this.#low : this.#high;
    return Math.min(sent - offset, Date.now());
  }
}

export const serviceClock = new ServiceClock();

class Source {
  // What a view shows from one place. Both clocks count: one may be set, the other may stand while a machine sleeps.
  known = false;

  constructor() {
    this.#at(Date.now(), performance.now());
  }

  #at(time, monotonic) {
    [this.time, this.monotonic] = [time, monotonic];
  }

  asked() {
    // What is answered to a question that is asked now is as old as the question: call the result with the answer.
    const [time, monotonic] = [Date.now(), performance.now()];
    return () => this.#tell(time, monotonic);
  }

  told(sent) {
    // All that the service had told at this time of its clock has been heard.
    this.#tell(serviceClock.here(sent), performance.now());
  }

  #tell(time, monotonic) {
    this.known = true;
    this.#at(time, monotonic);
    age.look();
  }

  get age() {
    return Math.max(Date.now() - this.time, performance.now() - this.monotonic);
  }
}

class Age extends EventTarget {
  // The age of the view: of its oldest source, or of the service's last answer where it has none. Says "change" when what
  // is shown becomes stale or is so no more, and "tick" when the words of it may be others.
  service = new Source();
  stale = false;
  #sources = new Set();

  source(signal) {
    const made = new Source();
    this.#sources.add(made);
    signal?.addEventListener("abort", () => this.drop(made));
    return made;
  }

  drop(source) {
    this.#sources.delete(source);
  }

  clear() {
    // Another view is shown.
    this.#sources.clear();
  }

  get #oldest() {
    const all = this.#sources.size ? [...this.#sources] : [this.service];
    return all.reduce((oldest, source) => (source.age > oldest.age ? source : oldest));
  }

  get day() {
    return new Date(this.#oldest.time).toLocaleDateString("en-GB", { dateStyle: "long" });
  }

  get words() {
    const { known, time, age } = this.#oldest;
    if (!known) return this.stale ? "nothing heard yet" : "";
    return `as of ${new Date(time).toLocaleTimeString("en-GB")}${age < TOLD ? "" : `, ${ago(age)} ago`}`;
  }

  look() {
    const stale = this.#oldest.age > STALE;
    const changed = stale !== this.stale;
    this.stale = stale;
    this.dispatchEvent(new Event("tick"));
    if (changed) this.dispatchEvent(new Event("change"));
  }

  watch() {
    setInterval(() => this.look(), TICK);
    document.addEventListener("visibilitychange", () => this.look()); // timers of a hidden page may have slept
  }
}

function ago(age) {
  const seconds = Math.floor(age / 1000);
  if (seconds < 120) return `${seconds} s`;
  return seconds < 7200 ? `${Math.floor(seconds / 60)} min` : `${Math.floor(seconds / 3600)} h`;
}

export const age = new Age();

const seen = () => new Promise((done) => (document.hidden ? document.addEventListener("visibilitychange", done, { once: true }) : done()));

export async function repeated(every, ask, signal) {
  // The first answer to what a view shows; then it is asked for again and again, as long as somebody sees the page.
  const source = age.source(signal);
  const once = async () => {
    const answered = source.asked();
    const found = await ask();
    answered();
    return found;
  };
  const again = async (began) => {
    await new Promise((wake) => setTimeout(wake, Math.max(every / 4, every + began - performance.now())));
    await seen();
    if (signal.aborted) return;
    const next = performance.now();
    await once().catch(() => {}); // the view is as old as the last answer
    again(next);
  };
  const began = performance.now();
  const first = await once();
  again(began);
  return first;
}
