/** The boxes: how each is reached, how it is, what the doctor finds, and what is to be done next. */

import { BoxAct, Busy, LinkNote, LinkWord, Notices } from "../parts/box.js";
import { Facts, Note, Word } from "../parts/elements.js";
import { WiresOf } from "../parts/wires.js";
import { address } from "../shell/route.js";
import { html } from "../vendor/preact-htm.js";
import { counted, number } from "../words.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/wire.js").Check} Check */
/** @typedef {import("../shell/shell.js").StepProperties} StepProperties */

/** The words for a doctor's verdict. */
const VERDICTS = { fail: "fault", warn: "warning", good: "good", skipped: "not looked at" };

/** @param {StepProperties} properties */
export function Boxes({ state, box: chosen, connection }) {
  return html`<section tabindex="-1">
    <div class="row apart">
      <div class="row"><h1>Boxes</h1><a class="button ${state.boxes.length === 0 ? "first" : ""}" href=${address("new-box", null)}>New box</a></div>
      <p class="soft">${state.desk.computer}; studies are in ${state.desk.folder}</p>
    </div>
    ${state.boxes.length === 0 && html`<${Note} verdict="warn" text="No box is known to this computer."
      remedy="Make a new one here, and put its two files on its card. The key of a box that another computer knows is brought from there on the command line." />`}
    <ul class="list">
      ${state.boxes.map((box) => html`<li key=${box.id}>
        <${BoxCard} box=${box} is_chosen=${state.boxes.length > 1 && box.id === chosen?.id} connection=${connection} />
      </li>`)}
    </ul>
    ${state.strangers.length > 0 && html`<h2>Heard, but not usable here</h2>
      <ul class="list">${state.strangers.map((stranger) => html`<li key=${stranger.address}>
        <${Note} verdict="warn" text=${`${stranger.name || "A box"} at ${stranger.address}: ${stranger.problem.found}`} remedy=${stranger.problem.remedy} />
      </li>`)}</ul>`}
    ${state.desk.streams.length > 0 && html`<h2>For other programs</h2>
      <ul class="list">${state.desk.streams.map((words) => html`<li key=${words}>${words}</li>`)}</ul>`}
  </section>`;
}

/** @param {{box: BoxState, is_chosen: boolean, connection: import("../desk/connection.js").Connection}} properties */
function BoxCard({ box, is_chosen, connection }) {
  const { hello, health, live } = box;
  return html`<article class="card ${is_chosen ? "chosen-card" : ""}" aria-label=${box.name}>
    <div class="row apart">
      <div class="row"><h2>${box.name}</h2><${LinkWord} box=${box} /></div>
      <span class="soft">${[box.serial_number, box.link.by].filter(Boolean).join(" · ")}</span>
    </div>
    <${LinkNote} box=${box} />
    ${hello && html`<p class="sentence next">${hello.next}</p>`}
    <div class="row">
      ${hello && html`<a class="button" href=${address(first_step(box), box.id)}>${STEP_WORDS[first_step(box)]}</a>`}
      ${box.has_card && html`<a class="button" href=${address("card", box.id)}>The files for its card</a>`}
      ${hello && html`<a class="button" href=${address("settings", box.id)}>Settings</a>`}
      <${BoxAct} box=${box} needs="examine" action="examine" stays=${box.doing === "examining"}>Examine it<//>
    </div>
    <${Busy} box=${box} connection=${connection} />
    ${hello && html`<${Facts} facts=${[
      ["Camera", health?.camera],
      ["Frames per second", live && number(live.rate_hz, 1)],
      ["Temperature", health?.temperature_c != null && number(health.temperature_c, 0, "°C")],
      ["Frame", `${hello.size_px[0]} × ${hello.size_px[1]}`],
      ["Calibrated", yes_or_no(hello.is_calibrated)],
      ["Scene", yes_or_no(hello.has_scene)],
      ["Targets", hello.targets.map((it) => it.name).join(", ")],
      ["Program", hello.firmware],
    ]} />`}
    ${health?.wires && html`<div class="stack"><h3>Wires to other devices</h3><${WiresOf} wires=${health.wires} /></div>`}
    ${health?.warnings.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
    ${box.examination && html`<${Checks} examination=${box.examination} />`}
    <${Notices} box=${box} most=${3} />
  </article>`;
}

/** @param {boolean | null} it */
const yes_or_no = (it) => (it === null ? null : it ? "yes" : "not yet");

/** A camera that is not calibrated is aimed first. @param {BoxState} box */
const first_step = (box) => (box.hello?.next_step === "calibrate" ? "aim" : (box.hello?.next_step ?? "aim"));

/** @type {Record<string, string>} */
const STEP_WORDS = { aim: "Aim the camera", scene: "Measure the scene", session: "Begin a session" };

/** @param {{examination: NonNullable<BoxState["examination"]>}} properties */
function Checks({ examination: { checks } }) {
  const is_amiss = (/** @type {Check} */ check) => check.verdict === "fail" || check.verdict === "warn";
  const amiss = checks.filter(is_amiss);
  const others = checks.filter((check) => !is_amiss(check));
  return html`<div class="stack">
    <h3>${amiss.length === 0 ? "The doctor finds nothing amiss" : `The doctor finds ${counted(amiss.length, "thing")} amiss`}</h3>
    <${CheckList} checks=${amiss} />
    <details><summary>${counted(others.length, "other check")}</summary><${CheckList} checks=${others} /></details>
  </div>`;
}

/** @param {{checks: Check[]}} properties */
function CheckList({ checks }) {
  return checks.length > 0 && html`<ul class="list checks">
    ${checks.map((check) => html`<li key=${check.subject}>
      <${Word} verdict=${check.verdict}>${VERDICTS[check.verdict]}<//>
      <div><p><strong>${check.subject}</strong>: ${check.seen}</p>${check.remedy && html`<p class="soft">${check.remedy}</p>`}</div>
    </li>`)}
  </ul>`;
}
