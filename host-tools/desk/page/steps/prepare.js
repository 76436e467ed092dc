/** Before a session: the study and its protocol, who is measured, and by whom. */

import { get, of_box, of_study, post } from "../desk/requests.js";
import { can } from "../parts/box.js";
import { Act, Choice, Facts, Field, Note } from "../parts/elements.js";
import { ChooseStudy } from "../parts/study.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";
import { clock, counted, typed_number } from "../words.js";
import { LiveView } from "./live_view.js";
import { ProtocolEditor } from "./protocol_editor.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/wire.js").Study} Study */
/** @typedef {import("../desk/wire.js").Participant} Participant */
/** @typedef {import("../parts/study.js").Studies} Studies */

/** @param {{box: BoxState, studies: Studies, live: import("../draw/live.js").LiveFrames}} properties */
export function Prepare({ box, studies, live }) {
  const { study, list } = studies;
  const [is_making, set_making] = useState(false);
  const must_make = list !== null && list.length === 0;
  return html`
    <h1>Session</h1>
    <div class="columns">
      <div class="stack">
        <${ChooseStudy} studies=${studies} />
        ${is_making || must_make
          ? html`<${NewStudy} made=${(/** @type {Study} */ it) => (studies.replace(it), set_making(false))} />`
          : html`<div class="row"><button type="button" onClick=${() => set_making(true)}>New study</button></div>`}
        ${study && html`<${Protocol} study=${study} changed=${studies.replace} />`}
      </div>
      <div class="stack">
        ${study && html`<${Who} box=${box} study=${study} changed=${studies.replace} />`}
      </div>
    </div>
    <h2>What is measured now</h2>
    <${LiveView} box=${box} live=${live} />`;
}

/** A folder's name for a title. @param {string} title */
const folder_of = (title) =>
  title.toLowerCase().normalize("NFKD").replace(/[^a-z0-9]+/g, "-").replace(/^-+|-+$/g, "").slice(0, 32) || "study";

/** @param {{made: (study: Study) => void}} properties */
function NewStudy({ made }) {
  const [title, set_title] = useState("");
  const [supplied, set_supplied] = useState(/** @type {{word: string, protocol: import("../desk/wire.js").ProtocolView}[]} */ ([]));
  const [word, set_word] = useState("");
  useEffect(() => {
    get("/api/protocols").then((answer) => set_supplied(answer.supplied), () => {});
  }, []);
  const chosen = word || supplied[0]?.word;
  const about = supplied.find((it) => it.word === chosen)?.protocol;
  const make = async () => made(await post("/api/studies", { folder: folder_of(title), title: title.trim(), protocol: { supplied: chosen } }));
  return html`<form class="card" aria-label="New study" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
    <h2>New study</h2>
    <${Field} label="Title" value=${title} set=${set_title} maxlength="80" />
    <${Choice} label="Protocol to begin with" value=${chosen ?? ""} set=${set_word} choices=${supplied.map((it) => [it.word, it.protocol.fields.name])} />
    ${about && html`<p class="soft small">${about.fields.about}</p>`}
    <div class="row"><${Act} kind="first" type="submit" act=${make} disabled=${!title.trim() || !chosen}>Make the study<//></div>
  </form>`;
}

/** @param {{study: Study, changed: (study: Study) => void}} properties */
function Protocol({ study, changed }) {
  const [is_edited, set_edited] = useState(false);
  const { fields, trials, lasts_s } = study.protocol;
  if (is_edited) {
    return html`<${ProtocolEditor} study=${study} done=${(/** @type {Study | null} */ newer) => {
      if (newer) changed(newer);
      set_edited(false);
    }} />`;
  }
  return html`<article class="card" aria-label="Protocol">
    <div class="row apart"><h2>${fields.name}</h2><button type="button" onClick=${() => set_edited(true)}>Edit the protocol</button></div>
    <${Facts} facts=${[["Trials", trials], ["Takes at least", clock(lasts_s)], ["Order", order_words(fields.order)], ["Repeats", fields.repeats ?? 1]]} />
    <ol class="stack small">${fields.condition.map((/** @type {any} */ it) => html`<li key=${it.name}><strong>${it.label}</strong>, ${it.duration_s} s</li>`)}</ol>
  </article>`;
}

/** @param {{by: string, seed?: number}} order */
function order_words(order) {
  const words = { fixed: "as listed", random: `random, seed ${order.seed}`, latin_square: "Latin square" };
  return words[/** @type {keyof typeof words} */ (order.by)] ?? order.by;
}

/** @param {{box: BoxState, study: Study, changed: (study: Study) => void}} properties */
function Who({ box, study, changed }) {
  const [code, set_code] = useState("");
  const [operator, set_operator] = useState(sessionStorage.getItem("operator") ?? "");
  const chosen = study.participants.some((it) => it.code === code) ? code : (study.participants[0]?.code ?? "");
  const open = study.sessions.filter((it) => it.can_resume);
  const can_begin = can(box, "session_begin");
  const begin = () => {
    sessionStorage.setItem("operator", operator.trim());
    return post(of_box(box.id, "session/begin"), { study: study.folder, participant: chosen, operator: operator.trim() || null });
  };
  return html`
    ${open.length > 0 && html`<article class="card" aria-label="Sessions that are not over">
      <h2>Not over yet</h2>
      <ul class="list">${open.map((it) => html`<li key=${it.name} class="row apart">
        <span><strong>${it.name}</strong>, ${it.done} of ${counted(it.planned, "trial")}</span>
        <${Act} act=${() => post(of_box(box.id, "session/resume"), { study: study.folder, session: it.name })} disabled=${!can_begin}>Continue ${it.name}<//>
      </li>`)}</ul>
    </article>`}
    <article class="card" aria-label="Begin a session">
      <h2>Begin a session</h2>
      ${study.participants.length === 0
        ? html`<p>Add a participant first.</p>`
        : html`<div class="fields">
            <${Choice} label="Participant" value=${chosen} set=${set_code} choices=${study.participants.map((it) => [it.code, it.code])} />
            <${Field} label="Who measures" value=${operator} set=${set_operator} maxlength="80" />
          </div>
          ${!can_begin && html`<p class="soft">A session begins once the box is connected, calibrated and has its scene.</p>`}
          <div class="row"><${Act} kind="first" act=${begin} disabled=${!can_begin || !chosen}>Begin the session<//></div>`}
    </article>
    <${Participants} study=${study} changed=${(/** @type {Study} */ newer, /** @type {string} */ added) => (changed(newer), set_code(added))} />`;
}

const SEXES = /** @type {[string, string][]} */ ([["", "not given"], ["female", "female"], ["male", "male"], ["other", "other"]]);

/** @param {{study: Study, changed: (study: Study, code: string) => void}} properties */
function Participants({ study, changed }) {
  const empty = { code: "", age: "", sex: "", height: "", mass: "" };
  const [form, set_form] = useState(empty);
  const set = (/** @type {string} */ name) => (/** @type {string} */ value) => set_form({ ...form, [name]: value });
  const save = async () => {
    const { code, age, sex, height, mass } = form;
    const row = {
      code: code.trim(),
      age_years: typed_number(age, "Age, years"),
      sex: sex || null,
      height_cm: typed_number(height, "Height, cm"),
      mass_kg: typed_number(mass, "Mass, kg"),
    };
    changed(await post(of_study(study.folder, "participants"), row), row.code);
    set_form(empty);
  };
  const edit = (/** @type {Participant} */ it) => {
    const text = (/** @type {number | null} */ value) => (value === null ? "" : String(value));
    set_form({ code: it.code, age: text(it.age_years), sex: it.sex ?? "", height: text(it.height_cm), mass: text(it.mass_kg) });
  };
  const is_known = study.participants.some((it) => it.code === form.code.trim());
  return html`<form class="card" aria-label="Participants" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
    <h2>Participants</h2>
    <p class="soft small">By a code such as P01 alone: never a name, a date of birth or a hospital's number.</p>
    <div class="fields">
      <${Field} label="Code" value=${form.code} set=${set("code")} maxlength="12" autocomplete="off" />
      <${Field} label="Age, years" value=${form.age} set=${set("age")} inputmode="decimal" />
      <${Choice} label="Sex" value=${form.sex} set=${set("sex")} choices=${SEXES} />
      <${Field} label="Height, cm" value=${form.height} set=${set("height")} inputmode="decimal" />
      <${Field} label="Mass, kg" value=${form.mass} set=${set("mass")} inputmode="decimal" />
    </div>
    <div class="row"><${Act} type="submit" act=${save} disabled=${!form.code.trim()}>${is_known ? "Change" : "Add"}<//></div>
    ${study.participants.length > 0 && html`<div class="row small">
      ${study.participants.map((it) => html`<button type="button" class="plain" key=${it.code} onClick=${() => edit(it)} aria-label=${`Edit ${it.code}`}>${it.code}</button>`)}
    </div>`}
  </form>`;
}
