// The newest samples as the stream tells them: a ring of typed arrays that never grows.
export class Tail {
  #first = 0; // place of the oldest row
  length = 0;
  whole = Infinity; // from this time to the newest no second is missing

  constructor(width, capacity = 2048) {
    this.width = width;
    this.capacity = capacity;
    this.time = new Float64Array(capacity);
    this.data = new Float64Array(width * capacity);
  }

  clear() {
    this.length = 0;
    this.whole = Infinity;
  }

  place(row) {
    return (this.#first + row) % this.capacity;
  }

  timeOf(row) {
    return this.time[this.place(row)];
  }

  get newest() {
    return this.length ? this.timeOf(this.length - 1) : -1;
  }

  add(time, figures) {
    // False for a second that is known already.
    if (time <= this.newest) return false;
    if (time !== this.newest + 1 || !this.length) this.whole = time;
    if (this.length === this.capacity) this.#first = (this.#first + 1) % this.capacity;
    else this.length++;
    const at = this.place(this.length - 1);
    this.time[at] = time;
    for (let column = 0; column < this.width; column++) this.data[column * this.capacity + at] = figures[column] ?? NaN;
    this.whole = Math.max(this.whole, this.timeOf(0));
    return true;
  }

  from(time) {
    // Row of the first sample at this time or later.
    let [low, high] = [0, this.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.timeOf(middle) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
