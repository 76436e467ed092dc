/**
 * A session that goes on: the plan, and one card for what goes on now. What is possible is what the
 * desk says; every button tells it what the page has seen, so that nothing is done twice.
 */

import { of_box, post, report_of } from "../desk/requests.js";
import { BoxAct, useDeskNow } from "../parts/box.js";
import { Act, Dialog, Field, Note, Word } from "../parts/elements.js";
import { can_be_heard, play, unlock } from "../sound.js";
import { html, useEffect, useRef, useState } from "../vendor/preact-htm.js";
import { clock } from "../words.js";
import { LiveView } from "./live_view.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/wire.js").Session} SessionState */
/** @typedef {import("../desk/connection.js").Connection} Connection */
/** @typedef {{box: BoxState, session: SessionState, connection: Connection}} CardProperties */

/** @param {CardProperties & {live: import("../draw/live.js").LiveFrames}} properties */
export function Run({ box, session, connection, live }) {
  const { at, can } = session;
  const Card = CARDS[/** @type {keyof typeof CARDS} */ (at.is)];
  const is_live = at.is !== "over" && at.is !== "deciding";
  return html`
    <div class="row apart">
      <h1>${session.participant}: ${session.title}</h1>
      <div class="row">
        ${can.includes("stop") && html`<${EventAct} box=${box} session=${session} event="stop">Stop the session<//>`}
        <${BoxAct} box=${box} needs="session_close" action="session/close">Close it; it can be continued<//>
      </div>
    </div>
    <${Plan} session=${session} />
    ${session.warnings.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
    ${at.is !== "over" && html`<${Silent} />`}
    ${Card && html`<${Card} key=${`${at.is} ${at.place}`} box=${box} session=${session} connection=${connection} />`}
    ${is_live && html`<${LiveView} box=${box} live=${live} />`}`;
}

/** A page that nobody has clicked since it was opened may not make a sound. */
function Silent() {
  const [is_heard, set_heard] = useState(can_be_heard());
  useEffect(() => {
    const timer = setInterval(() => set_heard(can_be_heard()), 500);
    return () => clearInterval(timer);
  }, []);
  if (is_heard) return null;
  return html`<p class="row"><span>Tones are off until this page is used.</span>
    <${Act} act=${async () => (await unlock(), play("tick"), set_heard(can_be_heard()))}>Switch tones on<//></p>`;
}

/** The planned trials. @param {{session: SessionState}} properties */
function Plan({ session: { plan } }) {
  const signs = /** @type {Record<string, string>} */ ({ accepted: "✓", skipped: "–", now: "▶" });
  return html`<ol class="plan" aria-label="The trials">
    ${plan.map((it) => html`<li key=${it.place} aria-current=${it.status === "now" ? "step" : undefined} title=${it.why ?? ""}>
      <span aria-hidden="true">${signs[it.status] ?? it.place}</span> ${it.label}
      <span class="unseen">, ${it.status}</span>
    </li>`)}
  </ol>`;
}

/**
 * A button for an event of the session; with `asks`, it asks for a reason first.
 *
 * @param {{box: BoxState, session: SessionState, event: string, asks?: string, is_needed?: boolean, kind?: string, focus?: boolean, children?: unknown}} properties
 */
function EventAct({ box, session, event, asks, is_needed = true, children, ...others }) {
  const [is_asking, set_asking] = useState(false);
  const [why, set_why] = useState("");
  if (!session.can.includes(event)) return null;
  const send = (/** @type {string | null} */ reason) => post(of_box(box.id, "session/event"), { step: session.step, event, why: reason });
  if (!asks) return html`<${Act} act=${() => send(null)} ...${others}>${children}<//>`;
  return html`
    <${Act} act=${() => set_asking(true)} ...${others}>${children}<//>
    ${is_asking && html`<${Dialog} title=${asks} close=${() => set_asking(false)}>
      <form class="stack" onSubmit=${(/** @type {Event} */ it) => it.preventDefault()}>
        <${Field} label=${is_needed ? "Reason" : "Reason, if there is one"} value=${why} set=${set_why} maxlength="200" autocomplete="off" />
        <div class="row">
          <${Act} kind="first" type="submit" disabled=${is_needed && !why.trim()} act=${() => send(why.trim() || null)}>${children}<//>
          <button type="button" onClick=${() => set_asking(false)}>Back</button>
        </div>
      </form>
    <//>`}`;
}

/** Puts the keyboard's focus on what has become another card. */
function useFocus() {
  const heading = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => heading.current?.focus({ preventScroll: true }), []);
  return heading;
}

/** @param {CardProperties} properties */
function Resting({ box, session, connection }) {
  const left_s = ((session.at.until_at_ms ?? 0) - useDeskNow(connection)) / 1000;
  return html`<article class="card" aria-label="Rest">
    <h2>Rest before “${session.condition?.label}”</h2>
    <p class="huge" role="timer">${clock(Math.ceil(left_s))}</p>
    <div class="row">
      <${EventAct} box=${box} session=${session} event="end_rest" kind="first" focus>Go on now<//>
      <${EventAct} box=${box} session=${session} event="skip" asks="Why is this trial left out?">Skip it<//>
    </div>
  </article>`;
}

/** @param {CardProperties} properties */
function Instruct({ box, session }) {
  const { condition } = session;
  return html`<article class="card" aria-label="Instruction">
    <h2>${condition?.label}</h2>
    <p class="sentence">${condition?.instruction}</p>
    <div class="row">
      <${EventAct} box=${box} session=${session} event="ready" kind="first large" focus>Ready: begin<//>
      <${EventAct} box=${box} session=${session} event="skip" asks="Why is this trial left out?">Skip it<//>
    </div>
  </article>`;
}

/** @param {CardProperties} properties */
function Countdown({ box, session, connection }) {
  const left_s = ((session.at.until_at_ms ?? 0) - useDeskNow(connection, 50)) / 1000;
  return html`<article class="card" aria-label="Countdown">
    <h2>${session.condition?.label}</h2>
    <p class="huge" role="timer">${Math.max(0, Math.ceil(left_s))}</p>
    <div class="row"><${EventAct} box=${box} session=${session} event="cancel" focus>Not yet<//></div>
  </article>`;
}

/** The large word for what a trial is worth so far. */
const JUDGED = { wait: ["none", "…"], good: ["good", "GOOD"], look: ["warn", "LOOK"], stop: ["bad", "STOP"] };

/** @param {CardProperties} properties */
function Recording({ box, session, connection }) {
  const heading = useFocus();
  const now_ms = useDeskNow(connection, 100);
  const [verdict, word] = JUDGED[box.live?.judgement ?? "wait"];
  return html`<article class="card" aria-label="Recording">
    <div class="row apart"><h2 ref=${heading} tabindex="-1">Recording “${session.condition?.label}”</h2>
      <${EventAct} box=${box} session=${session} event="end">End it now<//></div>
    <div class="verdict ${verdict}">
      <strong role="status">${word}</strong>
      <span class="clock" role="timer">${recording_clock(session, now_ms)}</span>
      <ul>${box.live?.reasons.map((reason) => html`<li key=${reason.words}>${reason.words}${reason.remedy && html`<span class="soft"> – ${reason.remedy}</span>`}</li>`)}</ul>
    </div>
    <${Marks} box=${box} session=${session} connection=${connection} />
  </article>`;
}

/** The time since t = 0, or until the mark is due, and the time to go. @param {SessionState} session @param {number} now_ms */
function recording_clock({ at }, now_ms) {
  const begun_ms = at.zero_at_ms ?? at.first_frame_at_ms ?? at.begun_at_ms ?? now_ms;
  const elapsed = clock((now_ms - begun_ms) / 1000);
  if (at.mark_due_at_ms && !at.zero_at_ms) {
    const left_s = (at.mark_due_at_ms - now_ms) / 1000;
    return left_s > 0 ? `${elapsed}, mark in ${clock(Math.ceil(left_s))}` : `${elapsed}, mark now`;
  }
  return at.ends_at_ms ? `${elapsed}, ${clock(Math.ceil((at.ends_at_ms - now_ms) / 1000))} to go` : elapsed;
}

/** Marks by button, or by their key: 1 to 9. @param {CardProperties} properties */
function Marks({ box, session, connection }) {
  const { marks, marked } = session;
  const [error, set_error] = useState("");
  const mark = (/** @type {string} */ label, /** @type {number} */ page_ms) =>
    post(of_box(box.id, "session/mark"), { label, at_ms: connection.clock.now_ms(page_ms) }).then(
      () => set_error(""),
      (problem) => set_error(problem.message),
    );
  const labels = marks.join("\n");
  useEffect(() => {
    const press = (/** @type {KeyboardEvent} */ event) => {
      const label = marks[Number(event.key) - 1];
      const is_typing = event.target instanceof HTMLElement && event.target.matches("input, textarea, select");
      if (!label || event.repeat || event.ctrlKey || event.altKey || event.metaKey || is_typing) return;
      event.preventDefault();
      void mark(label, event.timeStamp);
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, [box.id, labels]);
  return html`<div class="stack" aria-label="Marks" role="group">
    ${marks.length > 0 && html`<div class="row">
      ${marks.map((label, index) => html`<button type="button" key=${label} onClick=${(/** @type {Event} */ event) => void mark(label, event.timeStamp)}>
        <kbd>${index + 1}</kbd> ${label}</button>`)}
    </div>`}
    ${error && html`<${Note} verdict="bad" text=${error} />`}
    ${marked.length > 0 && html`<ul class="list small" aria-live="polite">${marked.map((it) => html`<li key=${it.at_ms + it.label}>
      Mark “${it.label}” (${it.source})</li>`)}</ul>`}
  </div>`;
}

/** @param {CardProperties} properties */
function Judging({ box, session }) {
  return html`<article class="card" aria-label="Judging">
    <h2 role="status">The recording has ended, and is judged …</h2>
    <div class="row">
      <${EventAct} box=${box} session=${session} event="judge">Try again<//>
      <${EventAct} box=${box} session=${session} event="give_up" asks="Why is this recording given up?">Give it up<//>
    </div>
  </article>`;
}

/** @param {CardProperties} properties */
function Deciding({ box, session }) {
  const { grade, is_zeroed, ended, reasons, needs_reason, trial } = session.at;
  const looks = /** @type {const} */ ({ good: "good", doubtful: "warn", unusable: "bad" });
  return html`<article class="card" aria-label="Verdict">
    <h2>“${session.condition?.label}”: ${ended}</h2>
    <div class="verdict ${looks[grade ?? "unusable"]}">
      <strong>${grade}</strong>
      <ul>${reasons?.map((reason) => html`<li key=${reason.words}>${reason.words}${reason.remedy && html`<span class="soft"> – ${reason.remedy}</span>`}</li>`)}</ul>
    </div>
    ${!is_zeroed && html`<${Note} verdict="bad" text="There is no t = 0 as the protocol wants it: this recording cannot be accepted." />`}
    <div class="row">
      ${needs_reason
        ? html`<${EventAct} key="why" box=${box} session=${session} event="accept" asks="Why is an unusable recording accepted?">Accept<//>`
        : html`<${EventAct} key="accept" box=${box} session=${session} event="accept" kind="first large" focus>Accept<//>`}
      <${EventAct} box=${box} session=${session} event="repeat" asks="Why is it recorded again?" is_needed=${false} kind=${needs_reason ? "first large" : ""} focus=${needs_reason}>Repeat<//>
      <${EventAct} box=${box} session=${session} event="skip" asks="Why is this trial left out?">Skip it<//>
      ${trial && html`<a class="button" href=${report_of(session.study, session.name, trial)} target="_blank" rel="noopener">Its report</a>`}
    </div>
  </article>`;
}

/** @param {CardProperties} properties */
function Stopped({ box, session }) {
  return html`<article class="card" aria-label="Stopped">
    <h2>The session is stopped</h2>
    <p>It goes on where it was, now or another time.</p>
    <div class="row"><${EventAct} box=${box} session=${session} event="continue" kind="first" focus>Continue<//></div>
  </article>`;
}

/** @param {CardProperties} properties */
function Over({ session }) {
  const accepted = session.plan.filter((it) => it.status === "accepted").length;
  return html`<article class="card" aria-label="Over">
    <h2>The session is over</h2>
    <p class="sentence">${accepted} of ${session.plan.length} trials are accepted.</p>
    <div class="row"><a class="button" href="#trials">To the trials</a><a class="button" href="#study">To the study</a></div>
  </article>`;
}

const CARDS = {
  resting: Resting, instruct: Instruct, countdown: Countdown, recording: Recording,
  judging: Judging, deciding: Deciding, stopped: Stopped, over: Over,
};
