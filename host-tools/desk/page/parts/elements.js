/**
 * The elements that several steps share. All text goes in as text: nothing on this page is ever
 * read as markup.
 */

import { html, useEffect, useMemo, useRef, useState } from "../vendor/preact-htm.js";

/** The look of a verdict, by the word for it. Anything else is `none`. @type {Record<string, string>} */
const LOOKS = {
  good: "good", ok: "good", accepted: "good", GOOD: "good",
  warn: "warn", doubtful: "warn", LOOK: "warn",
  bad: "bad", fail: "bad", unusable: "bad", STOP: "bad",
};

/** @param {string} verdict */
export const look = (verdict) => LOOKS[verdict] ?? "none";

/** A verdict, which is read without colour, too. @param {{verdict: string, children?: unknown}} properties */
export function Word({ verdict, children }) {
  return html`<span class="word ${look(verdict)}">${children ?? verdict}</span>`;
}

/** Something that must be read. @param {{verdict: string, text: unknown, remedy?: unknown}} properties */
export function Note({ verdict, text, remedy }) {
  return html`<div class="note ${look(verdict)}">
    <p>${text}</p>
    ${remedy && html`<p class="remedy">${remedy}</p>`}
  </div>`;
}

/**
 * A button for what takes a while: it cannot be pressed twice, and an error stands beside it.
 *
 * @param {{act: () => Promise<unknown> | unknown, kind?: string, disabled?: boolean, waits?: boolean, focus?: boolean, children?: unknown}} properties
 *   One that `waits` cannot be pressed, and keeps the keyboard's focus, because it soon can be again.
 */
export function Act({ act, kind = "", disabled = false, waits = false, focus = false, children, ...others }) {
  const [is_busy, set_busy] = useState(false);
  const [error, set_error] = useState("");
  const button = useRef(/** @type {HTMLButtonElement | null} */ (null));
  const is_there = useRef(true);
  useEffect(() => {
    is_there.current = true;
    if (focus) button.current?.focus({ preventScroll: true });
    return () => (is_there.current = false);
  }, []);
  const press = async () => {
    set_busy(true);
    set_error("");
    try {
      await act();
    } catch (problem) {
      if (is_there.current) set_error(problem instanceof Error ? problem.message : String(problem));
    } finally {
      if (is_there.current) set_busy(false);
    }
  };
  return html`<button type="button" class=${kind} ref=${button} aria-busy=${is_busy} aria-disabled=${is_busy || waits}
      disabled=${disabled} onClick=${is_busy || waits ? undefined : press} ...${others}>${children}</button>
    ${error && html`<div class="note bad" role="alert"><p>${error}</p></div>`}`;
}

let ids = 0;

/** An id that nothing else on the page has. */
const useOwnId = () => useMemo(() => `own-${(ids += 1)}`, []);

/**
 * A labelled input.
 *
 * @param {{label: string, value: unknown, set: (value: string) => void, kind?: string, whole?: boolean, hint?: string}} properties
 *   `kind` is an input's type, or `textarea`. Other properties become the input's.
 */
export function Field({ label, value, set, kind = "text", whole = false, hint = "", ...others }) {
  const id = useOwnId();
  const write = (/** @type {Event} */ event) => set(/** @type {HTMLInputElement} */ (event.target).value);
  const described = hint ? `${id}-hint` : undefined;
  return html`<div class="field ${whole ? "whole" : ""}">
    <label for=${id}>${label}</label>
    ${kind === "textarea"
      ? html`<textarea id=${id} aria-describedby=${described} value=${value ?? ""} onInput=${write} ...${others}></textarea>`
      : html`<input id=${id} aria-describedby=${described} type=${kind} value=${value ?? ""} onInput=${write} ...${others} />`}
    ${hint && html`<span class="small soft" id=${described}>${hint}</span>`}
  </div>`;
}

/**
 * A choice among a few.
 *
 * @param {{label: string, value: string, set: (value: string) => void, choices: [string, string][]}} properties
 *   Each choice is its value and the words for it.
 */
export function Choice({ label, value, set, choices, ...others }) {
  const id = useOwnId();
  return html`<div class="field">
    <label for=${id}>${label}</label>
    <select id=${id} value=${value} onChange=${(/** @type {Event} */ event) => set(/** @type {HTMLSelectElement} */ (event.target).value)} ...${others}>
      ${choices.map(([choice, words]) => html`<option key=${choice} value=${choice} selected=${choice === value}>${words}</option>`)}
    </select>
  </div>`;
}

/** @param {{label: string, value: boolean, set: (value: boolean) => void}} properties */
export function Tick({ label, value, set }) {
  const change = (/** @type {Event} */ event) => set(/** @type {HTMLInputElement} */ (event.target).checked);
  return html`<label class="tick"><input type="checkbox" checked=${value} onChange=${change} /> <span>${label}</span></label>`;
}

/**
 * A figure as a bar, from 0 to `most`, with its words, and a mark at what is wanted or was best.
 *
 * @param {{label: string, words: string, value: number, most: number, verdict?: string, mark?: number}} properties
 */
export function Meter({ label, words, value, most, verdict = "good", mark }) {
  const percent = (/** @type {number} */ it) => `${Math.max(0, Math.min(100, (100 * it) / most))}%`;
  return html`<div class="meter">
    <div class="row apart"><span>${label}</span><strong>${words}</strong></div>
    <div class="bar" aria-hidden="true">
      <div class="fill ${verdict === "good" ? "" : look(verdict)}" style=${{ width: percent(value) }}></div>
      ${mark !== undefined && html`<div class="mark" style=${{ left: percent(mark) }}></div>`}
    </div>
  </div>`;
}

/** Figures with their names. @param {{facts: [string, unknown][]}} properties */
export function Facts({ facts }) {
  const shown = facts.filter(([, value]) => value || value === 0);
  return html`<dl class="facts">
    ${shown.map(([name, value]) => html`<div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}
  </dl>`;
}

/**
 * A question that must be answered before anything else.
 *
 * @param {{title: string, close: () => void, children?: unknown}} properties
 */
export function Dialog({ title, close, children }) {
  const dialog = useRef(/** @type {HTMLDialogElement | null} */ (null));
  useEffect(() => {
    dialog.current?.showModal();
  }, []);
  return html`<dialog ref=${dialog} aria-labelledby="dialog-title" onCancel=${close} onClose=${close}>
    <div class="stack"><h2 id="dialog-title">${title}</h2>${children}</div>
  </dialog>`;
}

/** A drawing that is kept up to date outside of the page's elements. */
export function Drawing({ keep, label, name = "" }) {
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  useEffect(() => (canvas.current ? keep(canvas.current) : undefined), [keep]);
  return html`<canvas ref=${canvas} class=${name} role="img" aria-label=${label}></canvas>`;
}
