/** The protocol of a study, to be edited; the desk checks it while one types. */

import { of_study, post, problem_words } from "../desk/requests.js";
import { useChecked } from "../parts/checked.js";
import { Act, Choice, Field, Note, Tick } from "../parts/elements.js";
import { html, useState } from "../vendor/preact-htm.js";
import { clock, counted, needed_number } from "../words.js";

/** @typedef {import("../desk/wire.js").Study} Study */
/** Fields as they are typed; numbers are texts. @typedef {Record<string, any>} Draft */

/** @type {[string, string][]} */
const ORDERS = [["fixed", "as listed"], ["random", "random"], ["latin_square", "Latin square"]];
/** @type {[string, string][]} */
const ZEROS = [["start", "the first frame"], ["mark", "a mark"], ["onset", "standing up"]];

/** @param {any} fields @returns {Draft} */
const draft_of = (fields) => ({
  ...structuredClone(fields),
  repeats: fields.repeats ?? 1,
  marks: (fields.marks ?? []).join(", "),
  bins: fields.bins_s.map((/** @type {number[]} */ bin) => bin.join(" to ")).join(", "),
});

/** @param {string} text */
const parts = (text) => text.split(",").map((it) => it.trim()).filter(Boolean);

/** What the desk reads; throws what is no number. @param {Draft} draft */
function fields_of({ marks, bins, ...draft }) {
  const is_random = draft.order.by === "random";
  return {
    ...draft,
    about: draft.about?.trim() || null,
    order: is_random ? { by: "random", seed: needed_number(draft.order.seed ?? 1, "Seed") } : { by: draft.order.by },
    repeats: needed_number(draft.repeats, "Repeats of each"),
    rest_s: needed_number(draft.rest_s ?? 0, "Rest between trials, s"),
    countdown_s: needed_number(draft.countdown_s ?? 0, "Countdown, s"),
    marks: parts(marks),
    bins_s: parts(bins).map((bin) => bin.split(/\s*(?:to|–)\s*/).map((end) => needed_number(end, "Times that are compared, s"))),
    condition: draft.condition.map((/** @type {any} */ it) => ({
      ...it,
      baseline_s: needed_number(it.baseline_s ?? 0, "Before t = 0, s"),
      duration_s: needed_number(it.duration_s, "Measured for, s"),
    })),
  };
}

/** @param {{study: Study, done: (study: Study | null) => void}} properties */
export function ProtocolEditor({ study, done }) {
  const [draft, set_draft] = useState(() => draft_of(study.protocol.fields));
  const as_sent = (/** @type {Draft} */ it) => ({ protocol: { fields: fields_of(it) } });
  const checked = useChecked("/api/protocols/check", draft, as_sent);
  const set = (/** @type {string} */ name) => (/** @type {any} */ value) => set_draft({ ...draft, [name]: value });
  const save = async () => done(await post(of_study(study.folder, "protocol"), as_sent(draft)));
  const tones = draft.tones ?? { start: false, end: false };
  return html`<form class="card" aria-label="Edit the protocol" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
    <h2>Protocol</h2>
    <p class="soft small">For sessions that begin from now on.</p>
    <div class="fields">
      <${Field} label="Name" value=${draft.name} set=${set("name")} whole />
      <${Field} label="About" value=${draft.about} set=${set("about")} kind="textarea" whole />
      <${Choice} label="Order" value=${draft.order.by} set=${(/** @type {string} */ by) => set("order")({ ...draft.order, by })} choices=${ORDERS} />
      ${draft.order.by === "random" && html`<${Field} label="Seed" value=${draft.order.seed ?? 1} set=${(/** @type {string} */ seed) => set("order")({ by: "random", seed })} inputmode="numeric" />`}
      <${Field} label="Repeats of each" value=${draft.repeats} set=${set("repeats")} inputmode="numeric" />
      <${Field} label="Rest between trials, s" value=${draft.rest_s} set=${set("rest_s")} inputmode="decimal" />
      <${Field} label="Countdown, s" value=${draft.countdown_s} set=${set("countdown_s")} inputmode="decimal" />
      <${Choice} label="t = 0 is" value=${draft.zero} set=${set("zero")} choices=${ZEROS} />
      <${Field} label="Marks, with keys 1 to 9" value=${draft.marks} set=${set("marks")} hint="separated by commas" />
      <${Field} label="Times that are compared, s" value=${draft.bins} set=${set("bins")} hint="such as 0 to 20, 20 to 40" />
      <${Tick} label="Tone at the start" value=${tones.start} set=${(/** @type {boolean} */ start) => set("tones")({ ...tones, start })} />
      <${Tick} label="Tone at the end" value=${tones.end} set=${(/** @type {boolean} */ end) => set("tones")({ ...tones, end })} />
    </div>
    <${Conditions} list=${draft.condition} zero=${draft.zero} set=${set("condition")} />
    <div aria-live="polite">
      ${checked.problem && html`<${Note} verdict="warn" text=${problem_words({ ...checked.problem, remedy: "" })} remedy=${checked.problem.remedy} />`}
      ${checked.protocol && html`<p>${counted(checked.protocol.trials, "trial")}, at least ${clock(checked.protocol.lasts_s)}</p>`}
    </div>
    <div class="row">
      <${Act} kind="first" type="submit" act=${save} disabled=${Boolean(checked.problem)}>Save the protocol<//>
      <button type="button" onClick=${() => done(null)}>Leave it as it was</button>
    </div>
  </form>`;
}

/** @param {{list: any[], zero: string, set: (list: any[]) => void}} properties */
function Conditions({ list, zero, set }) {
  const change = (/** @type {number} */ at, /** @type {string} */ name) => (/** @type {string} */ value) =>
    set(list.map((it, index) => (index === at ? { ...it, [name]: value } : it)));
  const up = (/** @type {number} */ at) => set([...list.slice(0, at - 1), list[at], list[at - 1], ...list.slice(at + 1)]);
  const add = () => set([...list, { name: `condition-${list.length + 1}`, label: "", instruction: "", duration_s: 30 }]);
  return html`<div class="condition-rows">
    ${list.map((it, at) => html`<fieldset key=${at}>
      <legend>Condition ${at + 1}</legend>
      <div class="fields">
        <${Field} label="Name on the screen" value=${it.label} set=${change(at, "label")} />
        <${Field} label="Name in files" value=${it.name} set=${change(at, "name")} />
        <${Field} label="Measured for, s" value=${it.duration_s} set=${change(at, "duration_s")} inputmode="decimal" />
        ${zero !== "start" && html`<${Field} label="Before t = 0, s" value=${it.baseline_s ?? 0} set=${change(at, "baseline_s")} inputmode="decimal" />`}
        <${Field} label="Instruction, read out before each trial" value=${it.instruction} set=${change(at, "instruction")} kind="textarea" whole />
      </div>
      <div class="row">
        <button type="button" disabled=${at === 0} onClick=${() => up(at)} aria-label=${`Move condition ${at + 1} up`}>Up</button>
        <button type="button" disabled=${list.length === 1} onClick=${() => set(list.filter((_, index) => index !== at))} aria-label=${`Remove condition ${at + 1}`}>Remove</button>
      </div>
    </fieldset>`)}
    <div class="row"><button type="button" onClick=${add}>Add a condition</button></div>
  </div>`;
}
