/**
 * A new box: a form for what it has to know, and then the two files for its card, with where they go. The
 * same form corrects the files of a box that was never heard.
 */

import { get, of_box, post, save } from "../desk/requests.js";
import { Act, Field, Note } from "../parts/elements.js";
import { CameraFields, ExpertText, NetworkFields, SettingsProblem, WireFields, draft_of, fields_of, useCheckedSettings } from "../parts/settings_form.js";
import { address, go } from "../shell/route.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";

/** @typedef {import("../desk/wire.js").NewBoxForm} NewBoxForm */
/** @typedef {import("../shell/shell.js").StepProperties} StepProperties */

/** What the desk answers, once it has. @template T @param {string} path @returns {[T | null, string]} */
function useAnswer(path) {
  const [answer, set_answer] = useState(/** @type {any} */ (null));
  const [error, set_error] = useState("");
  useEffect(() => {
    get(path).then(set_answer, (problem) => set_error(problem.message));
  }, [path]);
  return [answer, error];
}

/** A number that no box here has. @param {import("../desk/wire.js").State} state */
function free_number({ boxes }) {
  const taken = new Set(boxes.map((it) => it.serial_number));
  for (let at = 1; ; at += 1) {
    const number = `PL-${String(at).padStart(4, "0")}`;
    if (!taken.has(number)) return number;
  }
}

/** @param {StepProperties} properties */
export function NewBox({ state }) {
  const [form, error] = /** @type {[NewBoxForm | null, string]} */ (useAnswer("/api/new-box"));
  return html`<section tabindex="-1">
    <h1>A new box</h1>
    <p>The box gets two files on its card: what it has to know, and a key by which it and this computer know each other.
      Everything can be changed later, from here.</p>
    ${error && html`<${Note} verdict="bad" text=${error} />`}
    ${form && html`<${Form} first=${form} number=${free_number(state)} replaces=${null} />`}
  </section>`;
}

/** @param {{first: NewBoxForm, number: string, replaces: string | null}} properties */
function Form({ first, number, replaces }) {
  const [draft, set_draft] = useState(() => beginning(first, number, replaces));
  const [size, set_size] = useState(first.size_px.join("x"));
  const [text, set_text] = useState(/** @type {string | null} */ (null));
  const settings = text === null ? { fields: fields_of(draft) } : { text };
  const checked = useCheckedSettings(settings);
  const size_px = size.split(/[x×*]/).map((it) => Number(it.trim()));
  const is_size = size_px.length === 2 && size_px.every((it) => Number.isInteger(it) && it > 0 && it < 65536);
  const set = (/** @type {string} */ name) => (/** @type {string} */ value) => set_draft({ ...draft, [name]: value });
  const has_name = text !== null || String(draft.device).trim() !== "";
  const make = async () => {
    const made = await post("/api/new-box", { settings, size_px, replaces });
    go("card", made.id);
  };
  return html`<form class="card" aria-label="The new box" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
    <div class="fields">
      ${text === null && html`
        <${Field} label="Name" value=${draft.device} set=${set("device")} maxlength="24" hint="such as ward 3" />
        <${Field} label="Serial number" value=${draft.serial_number} set=${set("serial_number")} maxlength="24" readonly=${replaces !== null}
          hint=${replaces === null ? "no two boxes have the same" : "it stays: its key is kept by it"} />`}
      <${Field} label="Size of the frames" value=${size} set=${set_size} pattern="[0-9]+ *[x×*] *[0-9]+" hint="of the camera: width x height" />
    </div>
    ${text === null && html`
      <${CameraFields} draft=${draft} set=${set_draft} is_new=${true} />
      <${NetworkFields} draft=${draft} set=${set_draft} addresses=${first.addresses} />
      <${WireFields} draft=${draft} set=${set_draft} />`}
    <${ExpertText} text=${text} first=${checked.settings?.text ?? first.settings.text} set=${set_text} />
    <${SettingsProblem} problem=${checked.problem} />
    ${!is_size && html`<${Note} verdict="warn" text="The size of the frames cannot be read." remedy="Give width x height, such as 1456x1088." />`}
    ${!has_name && html`<p class="soft">Give the box a name by which people know it.</p>`}
    <div class="row"><${Act} kind="first" type="submit" act=${make} disabled=${Boolean(checked.problem) || !is_size || !has_name}>
      ${replaces === null ? "Make the box" : "Make its files again"}<//></div>
  </form>`;
}

/** @param {NewBoxForm} first @param {string} number @param {string | null} replaces */
function beginning(first, number, replaces) {
  const draft = draft_of(first.settings.fields);
  if (replaces !== null) return draft;
  return { ...draft, device: "", serial_number: number, links: { ...draft.links, udp: first.addresses[0] ?? "" } };
}

/** The files for the card of a box that was never heard. @param {StepProperties} properties */
export function Card({ box: chosen }) {
  const box = /** @type {import("../desk/wire.js").BoxState} */ (chosen);
  const [is_changing, set_changing] = useState(false);
  if (!box.has_card) return html`<${Heard} box=${box} />`;
  const keep = (/** @type {string} */ name) => () => save(of_box(box.id, `card/${name}`), name);
  return html`<section tabindex="-1">
    <h1>The card of ${box.name}</h1>
    <div class="columns">
      <article class="card" aria-label="Two files">
        <h2>Two files</h2>
        <div class="row"><${Act} kind="first" act=${keep("config.plb")}>Download config.plb<//></div>
        <p>What the box has to know.</p>
        <div class="row"><${Act} kind="first" act=${keep("box.key")}>Download box.key<//></div>
        <${Note} verdict="warn" text="box.key is secret: whoever has it can read what the box sends, and command the box."
          remedy="Send it to nobody, and remove it from this computer's downloads once it is on the card. It can be downloaded until the box is heard for the first time." />
      </article>
      <article class="card" aria-label="Where they go">
        <h2>Where they go</h2>
        <ol class="list numbered">
          <li>Put the box's card into this computer. It shows up as a drive, <strong>PLUMBLINE</strong>.</li>
          <li>Copy both files to the top of that drive, into no folder. Their names stay <strong>config.plb</strong> and <strong>box.key</strong>.</li>
          <li>Eject the drive, put the card into the box, and switch the box on.</li>
          <li>Remove box.key from the downloads.</li>
        </ol>
        <p>These are the only files that are ever carried to the box.</p>
        <div class="row"><a class="button" href=${address("boxes", box.id)}>Go on to the boxes: it is looked for</a></div>
      </article>
    </div>
    ${is_changing
      ? html`<${Again} box=${box} />`
      : html`<div class="row"><button type="button" onClick=${() => set_changing(true)}>Correct what it has to know</button></div>`}
  </section>`;
}

/** @param {{box: import("../desk/wire.js").BoxState}} properties */
const Heard = ({ box }) => html`<section tabindex="-1">
  <h1>The card of ${box.name}</h1>
  ${box.hello
    ? html`<${Note} verdict="good" text="The box is heard: its card is as it should be." remedy="Its settings are changed from here; it needs no other card." />`
    : html`<${Note} verdict="warn" text="The files for its card are not here." remedy="Another card is written on the command line of the computer where the box was made." />`}
  <div class="row"><a class="button" href=${address("boxes", box.id)}>Go on to the boxes</a></div>
</section>`;

/** @param {{box: import("../desk/wire.js").BoxState}} properties */
function Again({ box }) {
  const [card, error] = /** @type {[import("../desk/wire.js").Card | null, string]} */ (useAnswer(of_box(box.id, "card")));
  const [form] = /** @type {[NewBoxForm | null, string]} */ (useAnswer("/api/new-box"));
  if (error) return html`<${Note} verdict="bad" text=${error} />`;
  return card && form && html`<${Form} first=${{ ...form, settings: card.settings, size_px: card.size_px }} number="" replaces=${box.id} />
    <p class="soft small">Download config.plb again afterwards; box.key stays the same.</p>`;
}
