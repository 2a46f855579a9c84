// The little linear algebra that pictures need; proofs are checked by the service, not here.

export const fraction = (text) => {
  const [above, below = "1"] = String(text).split("/");
  return Number(above) / Number(below);
};

export const numbers = (rows) => rows.map((row) => row.map(fraction));

export const product = (a, b) => a.map((row) => b[0].map((_, j) => row.reduce((sum, item, k) => sum + item * b[k][j], 0)));

export const sum = (a, b) => a.map((row, i) => row.map((item, j) => item + b[i][j]));

export const apply = (a, x) => a.map((row) => row.reduce((total, item, k) => total + item * x[k], 0));

export function symmetric(triangle, size, unit) {
  // A symmetric matrix from its upper triangle, row after row, in units of 1 / unit.
  const place = (i, j) => (Math.min(i, j) * (2 * size - Math.min(i, j) - 1)) / 2 + Math.max(i, j);
  return Array.from({ length: size }, (_, i) => Array.from({ length: size }, (__, j) => triangle[place(i, j)] / unit));
}

export function inverse(matrix) {
  // Gauss and Jordan with the largest pivot.
  const n = matrix.length;
  const rows = matrix.map((row, i) => [...row, ...row.map((_, j) => Number(i === j))]);
  for (let k = 0; k < n; k++) {
    const best = rows.slice(k).reduce((top, row, place) => (Math.abs(row[k]) > Math.abs(rows[top][k]) ? place + k : top), k);
    [rows[k], rows[best]] = [rows[best], rows[k]];
    const pivot = rows[k][k];
    rows[k] = rows[k].map((item) => item / pivot);
    for (let i = 0; i < n; i++) if (i !== k && rows[i][k]) {
      const factor = rows[i][k];
      rows[i] = rows[i].map((item, j) => item - factor * rows[k][j]);
    }
  }
  return rows.map((row) => row.slice(n));
}

export function outline(shape, i, j, points = 120) {
  // The border of the shadow that {x : x' inverse(shape) x = 1} throws on axes i and j: L (cos, sin) with L L' the part of `shape`.
  const first = Math.sqrt(shape[i][i]);
  const slant = shape[i][j] / first;
  const second = Math.sqrt(Math.max(shape[j][j] - slant * slant, 0));
  return Array.from({ length: points }, (_, k) => {
    const angle = (2 * Math.PI * k) / points;
    return [first * Math.cos(angle), slant * Math.cos(angle) + second * Math.sin(angle)];
  });
}

export function drawn(seed) {
  // Reproducible numbers in [-1, 1] (mulberry32).
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2147483648 - 1;
  };
}
