/** Trials: every recording of the study, what it is worth, what became of it, and its report. */

import { report_of } from "../desk/requests.js";
import { Note, Word } from "../parts/elements.js";
import { ChooseStudy, useStudies } from "../parts/study.js";
import { html } from "../vendor/preact-htm.js";
import { time_of_day } from "../words.js";

/** @typedef {import("../desk/wire.js").SessionRow} SessionRow */

/** The words for what became of a recording. */
const OUTCOMES = { open: "not decided", accepted: "accepted", rejected: "not used", nothing: "nothing recorded" };

/** @param {import("../shell/shell.js").StepProperties} properties */
export function Trials({ state }) {
  const studies = useStudies(state);
  const { study, list } = studies;
  return html`<section tabindex="-1">
    <h1>Trials</h1>
    <${ChooseStudy} studies=${studies} />
    ${list?.length === 0 && html`<p>There is no study yet.</p>`}
    ${study && study.sessions.length === 0 && html`<p>Nothing has been measured yet.</p>`}
    ${study?.sessions.map((session) => html`<${OfSession} key=${session.name} study=${study.folder} session=${session} />`)}
  </section>`;
}

/** @param {{study: string, session: SessionRow}} properties */
function OfSession({ study, session }) {
  const { name, trials, done, planned, started, problem } = session;
  return html`<article class="card" aria-label=${name}>
    <div class="row apart"><h2>${name}</h2><span class="soft">${time_of_day(started)}; ${done} of ${planned} done, ${session.state}</span></div>
    ${problem && html`<${Note} verdict="bad" text=${problem.found} remedy=${problem.remedy} />`}
    ${trials.length > 0 && html`<div class="scroll" tabindex="0" role="region" aria-label=${`Trials of ${name}`}><table>
      <thead><tr><th scope="col">Trial</th><th scope="col">Condition</th><th scope="col">Verdict</th><th scope="col">Decision</th><th scope="col">Report</th></tr></thead>
      <tbody>${trials.map((trial) => html`<tr key=${trial.folder}>
        <td>${trial.folder}</td>
        <td>${trial.condition}</td>
        <td>${trial.grade ? html`<${Word} verdict=${trial.grade} />` : "–"}</td>
        <td>${OUTCOMES[trial.outcome]}${trial.why && html`<span class="soft">: ${trial.why}</span>`}</td>
        <td>${trial.has_report && html`<a href=${report_of(study, name, trial.folder)} target="_blank" rel="noopener">Report<span class="unseen"> of ${trial.folder}</span></a>`}</td>
      </tr>`)}</tbody>
    </table></div>`}
  </article>`;
}
