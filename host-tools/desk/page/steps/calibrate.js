/**
 * Calibrate: the board is photographed at many places and tilts; the map fills up; the camera is
 * fitted, and given to the box.
 */

import { get, of_box, post } from "../desk/requests.js";
import { BoxAct, Busy, LinkNote, can, useDeskNow } from "../parts/box.js";
import { Act, Facts, Field, Note, Word } from "../parts/elements.js";
import { Picture } from "../parts/picture.js";
import { address } from "../shell/route.js";
import { html, useEffect, useRef, useState } from "../vendor/preact-htm.js";
import { counted, needed_number, number } from "../words.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/wire.js").Photographs} Set */
/** @typedef {import("../desk/connection.js").Connection} Connection */

/** @param {import("../shell/shell.js").StepProperties} properties */
export function Calibrate({ box: chosen, connection }) {
  const box = /** @type {BoxState} */ (chosen);
  const { photographs, calibration } = box;
  return html`<section tabindex="-1">
    <h1>Calibrate the camera</h1>
    <${LinkNote} box=${box} />
    <${Busy} box=${box} connection=${connection} />
    ${!photographs && html`<${Begin} key="first" box=${box} />`}
    ${photographs && html`<${Photographing} box=${box} set=${photographs} connection=${connection} />`}
    ${calibration && html`<${Calibrated} box=${box} calibration=${calibration} />`}
    ${photographs && html`<${Begin} key="again" box=${box} />`}
  </section>`;
}

/** The standard board. */
const BOARD = "9x6";
const PITCH = "20";

/** A new set of photographs. @param {{box: BoxState}} properties */
function Begin({ box }) {
  const [board, set_board] = useState(BOARD);
  const [pitch, set_pitch] = useState(PITCH);
  useEffect(() => {
    // The board as it is described on this computer, unless somebody has typed already.
    const take = (/** @type {import("../desk/wire.js").Prints} */ { targets }) => {
      const described = targets.find((it) => it.role === "scene" && it.pitch_mm !== null);
      if (!described) return;
      set_board((typed) => (typed === BOARD ? described.size.join("x") : typed));
      set_pitch((typed) => (typed === PITCH ? String(described.pitch_mm) : typed));
    };
    get("/api/prints").then(take, () => {});
  }, []);
  if (!can(box, "photographs_begin")) return null;
  const begin = () => {
    const corners = board.split(/[x×*]/).map((it) => needed_number(it, "Inner corners of the board"));
    const pitch_mm = needed_number(pitch, "From corner to corner, mm");
    return post(of_box(box.id, "photographs/begin"), { board: corners, pitch_mm });
  };
  const is_first = !box.photographs;
  return html`<details class="card" open=${is_first}>
    <summary><strong>${is_first ? "Photograph the board" : "Begin again with another set"}</strong></summary>
    <div class="stack">
      <p>Hold the board in the middle, in every corner and at every side of the frame, tilted by 20 to 40 degrees about both axes.
        Fifteen photographs are enough.</p>
      <div class="fields">
        <${Field} label="Inner corners of the board" value=${board} set=${set_board} pattern="[0-9]+[x×*][0-9]+" hint="columns x rows" />
        <${Field} label="From corner to corner, mm" value=${pitch} set=${set_pitch} inputmode="decimal" hint="measured on the print" />
      </div>
      <div class="row"><${Act} kind="first" act=${begin} focus=${is_first}>Begin<//></div>
    </div>
  </details>`;
}

/** @param {{box: BoxState, set: Set, connection: Connection}} properties */
function Photographing({ box, set, connection }) {
  const frame = useRef(/** @type {HTMLElement | null} */ (null));
  const [every_s, set_every_s] = useState("5");
  const to_full_screen = () => (document.fullscreenElement ? document.exitFullscreen() : frame.current?.requestFullscreen());
  const good = set.list.filter((photograph) => photograph.is_found);
  return html`
    <div class="aim columns wide-left" ref=${frame}>
      <div class="stack">
        <p class="sentence" aria-live="polite">${set.next}</p>
        ${box.aim && html`<${Picture} box=${box.id} aim=${box.aim}><${Countdown} set=${set} connection=${connection} /><//>`}
        <div class="row">
          ${!box.aim && html`<${BoxAct} box=${box} needs="aim_begin" action="aim/begin" kind="first">Go on photographing<//>`}
          <${BoxAct} box=${box} needs="photographs_take" action="photographs/take" kind="first" stays=${box.aim !== null}>Take one now<//>
          ${can(box, "photographs_auto") && html`
            <${BoxAct} box=${box} needs="photographs_auto" action="photographs/auto" body=${() => ({ count: 15, every_s: needed_number(every_s, "One every, s") })}>Take 15 by themselves<//>
            <label class="row"><span>one every</span>
              <input type="number" min="1" max="60" value=${every_s} onInput=${(/** @type {any} */ event) => set_every_s(event.target.value)} style=${{ width: "5rem" }} />
              <span>s</span></label>`}
          <${BoxAct} box=${box} needs="photographs_pause" action="photographs/pause">Pause<//>
          ${box.aim && html`<${Act} act=${to_full_screen}>Full screen<//>`}
          <${BoxAct} box=${box} needs="calibration_fit" action="calibration/fit" kind=${good.length >= 10 ? "first" : ""}>Calibrate with these<//>
        </div>
      </div>
      <div class="stack">
        <p><strong>${counted(good.length, "photograph")} with the board</strong>${set.list.length > good.length ? ` of ${set.list.length}` : ""};
          ${" "}${number(100 * set.share, 0)} % of the frame covered</p>
        <${Coverage} set=${set} />
        <${Photographs} box=${box} set=${set} />
      </div>
    </div>
    <p class="soft small">Kept in ${set.folder}</p>`;
}

/** The seconds until the next photograph. @param {{set: Set, connection: Connection}} properties */
function Countdown({ set, connection }) {
  const now_ms = useDeskNow(connection, 100);
  if (set.arriving !== null) return html`<div class="countdown">${number(100 * set.arriving, 0)} %</div>`;
  if (set.next_at_ms === null) return null;
  return html`<div class="countdown">${Math.max(0, Math.ceil((set.next_at_ms - now_ms) / 1000))}</div>`;
}

/** In how many photographs each part of the frame showed the board. @param {{set: Set}} properties */
export function Coverage({ set }) {
  const [across, down] = set.cells;
  // Before the first photograph there is no map.
  const cells = Array.from({ length: across * down }, (_, at) => set.covered[Math.floor(at / across)]?.[at % across] ?? 0);
  const bare = cells.filter((count) => count === 0).length;
  const label = `Map of the frame: ${cells.length - bare} of ${cells.length} parts have shown the board`;
  const look = (/** @type {number} */ count) => (count === 0 ? "" : count === 1 ? "some" : "full");
  return html`<div class="coverage" role="img" aria-label=${label} style=${{ gridTemplateColumns: `repeat(${across}, 1fr)` }}>
    ${cells.map((count, index) => html`<span key=${index} class=${look(count)}></span>`)}
  </div>`;
}

/** Each photograph, with its error once the camera is fitted. @param {{box: BoxState, set: Set}} properties */
function Photographs({ box, set }) {
  const errors = set.list.map((photograph) => photograph.error_px ?? 0);
  const most_px = Math.max(Number.MIN_VALUE, ...errors);
  const has_errors = errors.some((error) => error > 0);
  return html`
    ${has_errors && html`<figure>
      <div class="photographs" role="img" aria-label=${`Reprojection error of each photograph, at most ${number(most_px, 3, "px")}`}>
        ${set.list.map((photograph) => html`<span key=${photograph.number} class="photograph" style=${{ height: `${(100 * (photograph.error_px ?? 0)) / most_px}%` }}></span>`)}
      </div>
      <figcaption class="soft small">Reprojection error of each photograph; the highest bar is ${number(most_px, 3, "px")}</figcaption>
    </figure>`}
    ${set.list.length > 0 && html`<details>
      <summary>The photographs</summary>
      <div class="scroll" tabindex="0" role="region" aria-label="The photographs"><table>
        <thead><tr><th scope="col">Number</th><th scope="col">Board</th><th scope="col">Error, px</th><th scope="col"><span class="unseen">Remove</span></th></tr></thead>
        <tbody>${set.list.map((photograph) => html`<tr key=${photograph.number}>
          <td><a href=${of_box(box.id, `photographs/${photograph.number}.png`)} target="_blank" rel="noopener">${photograph.number}</a></td>
          <td><${Word} verdict=${photograph.is_found ? "good" : "warn"}>${photograph.is_found ? "found" : "not found"}<//>${!photograph.is_found && ` ${photograph.words}`}</td>
          <td class="number">${number(photograph.error_px, 3)}</td>
          <td><${BoxAct} box=${box} needs="photographs_remove" action="photographs/remove" body=${{ number: photograph.number }}
            aria-label=${`Remove photograph ${photograph.number}`}>Remove<//></td>
        </tr>`)}</tbody>
      </table></div>
    </details>`}`;
}

/** @param {{box: BoxState, calibration: import("../desk/wire.js").Calibration}} properties */
function Calibrated({ box, calibration }) {
  const { is_good, concerns, is_delivered } = calibration;
  return html`<article class="card" aria-label="The calibration">
    <div class="row apart"><h2>The camera</h2>
      <${Word} verdict=${is_good ? "good" : "warn"}>${is_good ? "good" : counted(concerns.length, "concern")}<//></div>
    ${concerns.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
    <${Facts} facts=${[
      ["Reprojection error", number(calibration.error_px, 3, "px")],
      ["Photographs used", `${calibration.used} of ${calibration.photographs}`],
      ["Lens model", calibration.model],
    ]} />
    <details><summary>Its numbers</summary><ul class="list small">${calibration.numbers.map((words) => html`<li key=${words}>${words}</li>`)}</ul></details>
    <details><summary>Where the errors are</summary>
      <img src=${`${of_box(box.id, "calibration/plot.svg")}?of=${calibration.error_px}-${calibration.used}`} alt="Each corner in the frame, and its error" /></details>
    ${is_delivered
      ? html`<${Note} verdict="good" text="The box has this camera." />`
      : html`<div class="row"><${BoxAct} box=${box} needs="calibration_deliver" action="calibration/deliver" kind="first">Give it to the box<//></div>`}
    <div class="row">${is_delivered && html`<a class="button" href=${address("scene", box.id)}>Go on to the scene</a>`}</div>
    <p class="soft small">Kept in ${calibration.file}</p>
  </article>`;
}
