// A certificate document as pictures need it: loops of its modes, graph, and the matrix of each node.
import { fraction, inverse, numbers, product, sum, symmetric } from "./matrix.js";

export const modeOf = (label) => (Array.isArray(label) ? label[0] : label);

export const spelled = (label) => (Array.isArray(label) ? `${label[0]} (gain ${label[1]}, clock ${label[2]})` : String(label));

export class Proof {
  constructor(document) {
    const { problem, claim, proof, about } = document;
    this.kind = claim.kind;
    this.value = fraction(claim.value);
    this.word = claim.word ?? [];
    this.problem = problem;
    this.about = about ?? {};
    this.modes = problem.modes.map((mode) => Object.fromEntries(Object.entries(mode).map(([name, rows]) => [name, numbers(rows)])));
    this.size = this.modes[0].A.length;
    this.peak = fraction(problem.peak ?? 1);
    this.nodes = proof.nodes;
    this.edges = [...proof.edges, ...proof.jumps].map(([from, ...rest]) => ({ from, labels: rest.slice(0, -1), to: rest.at(-1) }));
    this.shapes = (proof.matrices ?? []).map((triangle) => inverse(symmetric(triangle, this.size, proof.denominator)));
    this.gains = new Map((problem.gains ?? []).map(({ mode, clock, K }) => [`${mode},${clock}`, numbers(K)]));
  }

  loop(label) {
    // A of a mode, or A + B K of the gain that acts.
    const mode = this.modes[modeOf(label) - 1];
    return Array.isArray(label) ? sum(mode.A, product(mode.B, this.gains.get(`${label[1]},${label[2]}`))) : mode.A;
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
