// History in tiles: level L has steps of 2^L seconds; a tile holds BINS steps of every column in one typed array.
// Steps above one second are two rows, the least and the greatest. The tiles used least recently are dropped.
export const BINS = 512;
const KEPT = 32;

export const stepOf = (level) => 2 ** level;
export const rowsPerBin = (level) => (level ? 2 : 1);

export function levelFor(span, pixels) {
  // The finest level that gives no more than a step a pixel.
  return Math.max(0, Math.ceil(Math.log2(Math.max(span, 1) / Math.max(pixels, 50))));
}

export class Tiles {
  #tiles = new Map(); // "level/index" -> { filled, data }, the one used last at the end

  constructor(width) {
    this.width = width; // columns
  }

  get size() {
    return this.#tiles.size;
  }

  get(level, index) {
    const key = `${level}/${index}`;
    const tile = this.#tiles.get(key);
    if (tile) {
      this.#tiles.delete(key);
      this.#tiles.set(key, tile);
    }
    return tile;
  }

  #made(level, index) {
    const found = this.get(level, index);
    if (found) return found;
    const tile = { filled: 0, data: new Float64Array(this.width * BINS * rowsPerBin(level)).fill(NaN) };
    this.#tiles.set(`${level}/${index}`, tile);
    if (this.#tiles.size > KEPT) this.#tiles.delete(this.#tiles.keys().next().value);
    return tile;
  }

  clear() {
    this.#tiles.clear();
  }

  filledTo(level, bin) {
    // Up to which step (exclusive) the tile of this one is filled.
    const index = Math.floor(bin / BINS);
    return index * BINS + (this.get(level, index)?.filled ?? 0);
  }

  missing(level, first, last, most = 8) {
    // The first stretch [from, to) of steps within [first, last) that is not there, at most so many tiles of it.
    let from = null;
    for (let index = Math.floor(first / BINS); index * BINS < last; index++) {
      const [begin, end] = [index * BINS, Math.min(last, (index + 1) * BINS)];
      const filled = begin + (this.get(level, index)?.filled ?? 0);
      if (from === null && filled < end) from = filled;
      else if (from !== null && filled > begin) return [from, begin];
      if (from !== null && end - from >= most * BINS) return [from, end];
    }
    return from === null ? null : [from, last];
  }

  put(level, from, to, time, columns) {
    // Rows of the steps [from, to), by their times: what has no row stays unknown, but is not asked for again.
    const [step, per] = [stepOf(level), rowsPerBin(level)];
    for (let row = 0; row < time.length; row++) {
      const place = Math.floor((time[row] * per) / step + 1e-6);
      const bin = Math.floor(place / per);
      if (bin < from || bin >= to) continue;
      const tile = this.#made(level, Math.floor(bin / BINS));
      const at = place - Math.floor(bin / BINS) * BINS * per;
      for (let column = 0; column < this.width; column++) tile.data[column * BINS * per + at] = columns[column][row] ?? NaN;
    }
    for (let index = Math.floor(from / BINS); index * BINS < to; index++) {
      const tile = this.#made(level, index);
      tile.filled = Math.max(tile.filled, Math.min(BINS, to - index * BINS));
    }
  }
}
