// A certificate document as pictures need it: loops of its modes, graph, and the matrix of each node.
import { fraction, inverse, numbers, product, sum, symmetric } from "./matrix.js";

export const modeOf = (label) => (Array.isArray(label) ? label[0] : label);

export const spelled = (label) => (Array.isArray(label) ? `${label[0]} (gain ${label[1]}, clock ${label[2]})` : String(label));

const zeros = (rows, columns) => Array.from({ length: rows }, () => Array(columns).fill(0));

const diagonal = (a, b) => [...a.map((row) => [...row, ...Array(b[0].length).fill(0)]), ...b.map((row) => [...Array(a[0].length).fill(0), ...row])];

function at({ vary = [], ...mode }, values) {
  // The matrices of a mode where its parameters have these values.
  const found = Object.fromEntries(Object.entries(mode).map(([name, rows]) => [name, numbers(rows)]));
  vary.forEach((change, k) => Object.entries(change).forEach(([name, rows]) => (found[name] = sum(found[name], numbers(rows).map((row) => row.map((item) => item * values[k]))))));
  return found;
}

function sampled(mode, period) {
  // A, B and E of the samples of a mode in continuous time: the top of exp([A, B, E; 0, 0, 0] period).
  const names = ["A", "B", "E"].filter((name) => mode[name]);
  const size = mode.A.length;
  const wide = mode.A.map((_, i) => names.flatMap((name) => mode[name][i]));
  const halvings = 12;
  const exponent = [...wide, ...zeros(wide[0].length - size, wide[0].length)].map((row) => row.map((item) => (item * period) / 2 ** halvings));
  let term = exponent.map((row, i) => row.map((_, j) => Number(i === j)));
  let found = term;
  for (let k = 1; k < 12; k++) found = sum(found, (term = product(term, exponent).map((row) => row.map((item) => item / k))));
  for (let k = 0; k < halvings; k++) found = product(found, found);
  const starts = names.map((_, k) => names.slice(0, k).reduce((total, name) => total + mode[name][0].length, 0));
  const parts = names.map((name, k) => [name, found.slice(0, size).map((row) => row.slice(starts[k], starts[k] + mode[name][0].length))]);
  return { ...mode, ...Object.fromEntries(parts) };
}

function stacked({ K, A, B, C, D }) {
  // K, or [D C; B A] of a controller with a state of its own.
  if (K) return numbers(K);
  const [above, below] = [[numbers(D), numbers(C)], [numbers(B), numbers(A)]];
  return [above, below].flatMap(([one, two]) => one.map((row, k) => [...row, ...two[k]]));
}

function beside(mode, states) {
  // The mode with a controller's states beside its own: inputs (u, x_c+), measured (m, x_c).
  const unit = Array.from({ length: states }, (_, i) => Array.from({ length: states }, (__, j) => Number(i === j)));
  const taller = (rows) => rows && [...rows, ...zeros(states, rows[0].length)];
  return { ...mode, A: diagonal(mode.A, zeros(states, states)), B: diagonal(mode.B, unit), M: diagonal(mode.M, unit), E: taller(mode.E), N: taller(mode.N) };
}

export class Proof {
  constructor(document) {
    const { problem, claim, proof, about } = document;
    this.kind = claim.kind;
    this.value = fraction(claim.value);
    this.word = claim.word ?? [];
    this.problem = problem;
    this.about = about ?? {};
    this.parameters = (problem.parameters ?? []).map(({ low }) => fraction(low)); // pictures are of their least values
    this.modes = problem.modes.map((mode) => at(mode, this.parameters));
    if (problem.period) this.modes = this.modes.map((mode) => sampled(mode, fraction(problem.period)));
    this.gains = new Map((problem.gains ?? []).map((gain) => [`${gain.mode},${gain.clock}`, stacked(gain)]));
    const states = problem.gains?.[0]?.A?.length ?? 0;
    if (states) this.modes = this.modes.map((mode) => beside(mode, states));
    this.size = this.modes[0].A.length;
    this.peak = fraction(problem.peak ?? 1);
    this.nodes = proof.nodes;
    this.edges = [...proof.edges, ...proof.jumps].map(([from, ...rest]) => ({ from, labels: rest.slice(0, -1), to: rest.at(-1) }));
    const parts = this.parameters.length + 1; // of each node: a matrix at the least values, and what each parameter adds
    this.shapes = (proof.matrices ?? []).filter((_, k) => k % parts === 0).map((triangle) => inverse(symmetric(triangle, this.size, proof.denominator)));
  }

  loop(label) {
    // A of a mode, or A + B K of the gain that acts; A + B K M where it acts on what is measured.
    const mode = this.modes[modeOf(label) - 1];
    if (!Array.isArray(label)) return mode.A;
    const driven = product(mode.B, this.gains.get(`${label[1]},${label[2]}`));
    return sum(mode.A, mode.M ? product(driven, mode.M) : driven);
  }

  drive(label) {
    // E of a mode, or E + B K N where the gain that acts measures the disturbance, too.
    const mode = this.modes[modeOf(label) - 1];
    if (!Array.isArray(label) || !mode.M) return mode.E;
    return sum(mode.E, product(product(mode.B, this.gains.get(`${label[1]},${label[2]}`)), mode.N));
  }

  get decay() {
    // What the function of a node shrinks by in a sample, at the least.
    return this.kind === "stability" ? this.value : 1;
  }
}

export function constraintInWords({ kind, tau, burst, period, delay, clock, of, edges }) {
  // A switching constraint as a sentence would say it.
  const samples = (count) => `${count} sample${Number(count) === 1 ? "" : "s"}`;
  return {
    arbitrary: () => "any mode at any sample",
    dwell: () => `at least ${samples(tau)} between switches (dwell time)`,
    average: () => `at most ${burst} + (t − s)/${tau} switches in every interval [s, t] (average dwell time)`,
    persistent: () => `portions of at least ${samples(tau)} in one mode, at most ${samples(period)} apart (persistent dwell time)`,
    asynchronous: () => `at least ${samples(tau)} between switches; the old gain acts up to ${samples(delay)} more`,
    graph: () => `paths of a graph with ${edges.length} edges`,
    clocked: () => `${constraintInWords(of)}; gains by a clock up to ${clock}`,
  }[kind]();
}
