/** Print: the sheets with the targets, what to look at on the paper, and what was measured on it. */

import { get, post } from "../desk/requests.js";
import { Act, Choice, Field, Note } from "../parts/elements.js";
import { address } from "../shell/route.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";
import { counted, number_or_text } from "../words.js";

/** @typedef {import("../desk/wire.js").Prints} Prints */
/** @typedef {import("../desk/wire.js").Sheet} Sheet */

/** @type {[string, string][]} */
const PAPERS = [["a4", "A4"], ["letter", "Letter"]];

export function Print() {
  const [prints, set_prints] = useState(/** @type {Prints | null} */ (null));
  const [error, set_error] = useState("");
  const [paper, set_paper] = useState("a4");
  const [is_saved, set_saved] = useState(false);
  const save = async (/** @type {object} */ choice) => {
    set_saved(false);
    set_prints(await post("/api/prints", choice));
    set_saved(true);
  };
  useEffect(() => {
    get("/api/prints").then(set_prints, (problem) => set_error(problem.message));
  }, []);
  return html`<section tabindex="-1">
    <h1>Print the targets</h1>
    ${error && html`<div role="alert"><${Note} verdict="bad" text=${error} /></div>`}
    <p>Both are needed: the two targets that a person wears, and the board by which the camera is calibrated.</p>
    <div class="fields"><${Choice} label="Paper" value=${paper} set=${set_paper} choices=${PAPERS} /></div>
    ${prints && html`<div class="columns">${prints.sheets.map((sheet) => html`<${OneSheet} key=${sheet.word} sheet=${sheet} paper=${paper} />`)}</div>`}
    <article class="card" aria-label="What to look at">
      <h2>What to look at</h2>
      <ol class="list numbered">
        <li>Print at 100 % (“actual size”), never “fit to page”, on matt paper: gloss reflects lamps.</li>
        <li>Measure the ruler on each sheet: 100 mm. Otherwise the printer has scaled the sheet; print it again.</li>
        <li>Cut along the dashed lines, and leave the white margin: it belongs to the target.</li>
        <li>Glue each print to something flat and stiff: the board to glass or a stiff plate, the targets to 2 mm of plastic.
          Cardboard bends.</li>
      </ol>
    </article>
    ${prints && html`<${Measured} key=${prints.text} prints=${prints} save=${save} />`}
    <div role="status">${is_saved && html`<${Note} verdict="good" text="Kept." remedy="New boxes are told so, and each box when it gets its camera." />`}</div>
    <div class="row"><a class="button" href=${address("boxes", null)}>Go on to the boxes</a></div>
  </section>`;
}

/** @param {{sheet: Sheet, paper: string}} properties */
function OneSheet({ sheet, paper }) {
  const pages = sheet.pages[paper === "a4" ? 0 : 1];
  const file = `/api/prints/${sheet.word}-${paper}.pdf`;
  return html`<article class="card" aria-label=${sheet.title}>
    <h2>${sheet.title}</h2>
    <img class="sheet" src=${`/api/prints/${sheet.word}.svg`} alt=${`The sheet: ${sheet.title.toLowerCase()}, cutting lines and a ruler of 100 mm`} />
    <p class="soft">${counted(pages, "page")}, squares of ${sheet.pitch_mm} mm</p>
    <div class="row"><a class="button first" href=${file} download>${sheet.word === "board" ? "Download the board (PDF)" : "Download the targets (PDF)"}</a></div>
  </article>`;
}

/** How the prints have come out. @param {{prints: Prints, save: (choice: object) => Promise<void>}} properties */
function Measured({ prints, save }) {
  const regular = prints.targets.filter((it) => it.pitch_mm !== null);
  const [typed, set_typed] = useState(/** @type {Record<string, string>} */ (Object.fromEntries(regular.map((it) => [it.name, String(it.pitch_mm)]))));
  const [text, set_text] = useState(prints.text);
  const pitches_mm = Object.fromEntries(regular.map((it) => [it.name, number_or_text(typed[it.name])]));
  const is_number = Object.values(pitches_mm).every((it) => typeof it === "number" && it > 0);
  return html`<form class="card" aria-label="What was measured" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
    <h2>What was measured</h2>
    <p>Measure a whole row of squares, and divide by their number. If that is not what stands here, write what you measured: every
      length is wrong by as much as this, and nothing else shows it.</p>
    <div class="fields">
      ${regular.map((it) => html`<${Field} key=${it.name} label=${`Square of the ${ROLES[it.role]}, mm`} value=${typed[it.name]}
        set=${(/** @type {string} */ value) => set_typed({ ...typed, [it.name]: value })} inputmode="decimal" hint=${`${it.name}, ${it.size[0]} × ${it.size[1]} inner corners`} />`)}
    </div>
    ${prints.warnings.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
    <div class="row"><${Act} type="submit" act=${() => save({ pitches_mm })} disabled=${!is_number}>Keep what was measured<//></div>
    <details><summary>For experts: other targets</summary>
      <div class="stack">
        <p class="soft small">The text of ${prints.path}. Other grids are printed on the command line, and described here.</p>
        <${Field} label="targets.toml" value=${text} set=${set_text} kind="textarea" rows="18" spellcheck="false" class="code" whole />
        <div class="row"><${Act} act=${() => save({ text })} disabled=${text === prints.text}>Keep this text<//></div>
      </div>
    </details>
  </form>`;
}

/** @type {Record<string, string>} */
const ROLES = { lower: "target for the lower back", upper: "target for the shoulder", scene: "board" };
