// The certificate a twin is started with: what is proved of the chosen controller at the chosen station, and the choice.
import { Problem } from "../lib/api.js";
import { complain, field, h, set } from "../lib/dom.js";
import { fileInput } from "../lib/files.js";
import { quantity } from "../lib/format.js";
import { made, stateOf, verdictTag } from "../lib/service.js";
import { speak } from "../lib/speak.js";

const TYPING = 350; // so long nobody has typed before the service is asked [ms]

const WITHOUT = "Without one: the twin's state and its telemetry say uncertified.";
const CHECKED = "It is checked before the start, everything in it computed anew, which takes seconds.";
const REFUSED = "One that does not hold keeps the twin from starting.";
const ALLOWED = "One that does not hold is dropped, and the twin starts uncertified.";

export class CertificateChoice {
  #turn = 0;
  #asking = new AbortController();

  constructor(subjectOf, signal) {
    this.subjectOf = subjectOf; // what the form says now: { controller, station, options }, or why nothing is proved of it
    this.signal = signal;
    this.choice = h("select", { name: "certificate", onchange: () => this.#explain() },
      h("option", { value: "none" }, "none"), h("option", { value: "own" }, "this service's own"), h("option", { value: "file" }, "one from a file"));
    this.file = fileInput({ accept: ".json,application/json", name: "certificate_file" }, () => complain(this.file, ""));
    this.fileField = field("File", this.file, { hint: "as hrs certify --controller writes it" });
    this.allow = h("input", { type: "checkbox", name: "allow_uncertified", onchange: () => this.#explain() });
    this.allowed = h("label", { class: "tick" }, this.allow, " if it is refused, start uncertified all the same");
    this.known = h("p", { class: "known" });
    this.make = h("button", { type: "button", class: "plain", hidden: true, onclick: () => this.#have() }, "Have it made");
    const chosen = field("Certificate of service", this.choice, { hint: WITHOUT });
    this.hint = chosen.querySelector(".hint");
    this.element = h("fieldset", { class: "certificate" }, h("legend", { class: "unseen" }, "Certificate"),
      h("div", { class: "chosen" }, chosen, this.fileField, this.allowed), h("div", { class: "proved" }, this.known, this.make));
    signal.addEventListener("abort", () => this.#asking.abort());
    this.#explain();
  }

  #explain() {
    const { value } = this.choice;
    complain(this.choice, "");
    set(this.hint, value === "none" ? WITHOUT : `${CHECKED} ${this.allow.checked ? ALLOWED : REFUSED}`);
    this.fileField.hidden = value !== "file";
    this.allowed.hidden = value === "none";
  }

  changed() {
    // Controller, station or scenario are others: what is known of them?
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.#look(), TYPING);
  }

  async #look() {
    this.#asking.abort();
    this.#asking = new AbortController();
    const mine = ++this.#turn;
    const signal = AbortSignal.any([this.signal, this.#asking.signal]);
    const subject = await this.subjectOf();
    if (mine !== this.#turn) return;
    this.make.hidden = true;
    if (typeof subject === "string") return this.#say(subject);
    try {
      const found = await stateOf(subject, signal);
      if (mine !== this.#turn) return;
      if (found.state === "making") await this.#watch(subject, signal);
      else this.#tell(subject, found);
    } catch (error) {
      if (!signal.aborted) this.#say(error.message);
    }
  }

  #say(...parts) {
    this.known.replaceChildren(...parts);
    speak(this.known.textContent.replace(/, [^,]* …$/, ""));
  }

  #named({ controller, station, options }) {
    return `${[controller, options].filter(Boolean).join(":")} at ${station}`;
  }

  #tell(subject, { state, verdict, claim }) {
    const about = this.#named(subject);
    this.make.hidden = state !== "none";
    if (state === "none") return this.#say(`No certificate of ${about} has been made since the service started. Making one takes a minute or more.`);
    if (state === "failed") return this.#say(`A certificate of ${about} could not be made.`);
    const place = ["service", subject.controller, subject.station, subject.options].filter(Boolean).map(encodeURIComponent).join("/");
    const so = verdict === "certified" ? "" : " A twin that is started with it is refused.";
    this.#say(verdictTag(verdict), ` ${claim}.${so} `, h("a", { href: `#/certificates/${place}` }, "What is proved"));
  }

  async #watch(subject, signal) {
    this.make.hidden = true;
    const began = performance.now();
    const said = () => this.#say(`The certificate of ${this.#named(subject)} is being made: simulating, searching and proving, ${quantity((performance.now() - began) / 1000, "s")} …`);
    said();
    await made(subject, "certificate", signal, said);
    this.#tell(subject, await stateOf(subject, signal));
  }

  async #have() {
    const subject = await this.subjectOf();
    const signal = AbortSignal.any([this.signal, this.#asking.signal]);
    if (typeof subject === "string") return;
    await this.#watch(subject, signal).catch((error) => !signal.aborted && this.#say(error.message));
  }

  get chosen() {
    return this.choice.value !== "none";
  }

  async asked() {
    // The document as a text, or null.
    if (!this.chosen) return null;
    if (this.choice.value === "file") return this.#read();
    const subject = await this.subjectOf();
    if (typeof subject === "string") throw new Error(subject);
    return made(subject, "certificate", this.signal, () => {});
  }

  async #read() {
    const [file] = this.file.files;
    const wrong = (message) => new Problem(422, { errors: [{ field: "certificate_file", message }] });
    if (!file) throw wrong("choose one, or start without");
    const text = await file.text();
    try {
      JSON.parse(text);
    } catch (error) {
      throw wrong(`is no JSON document: ${error.message}`);
    }
    return text;
  }
}
