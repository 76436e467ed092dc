/** Study: how far it has come, and its report. */

import { report_of } from "../desk/requests.js";
import { Facts, Note } from "../parts/elements.js";
import { ChooseStudy, useStudies } from "../parts/study.js";
import { html } from "../vendor/preact-htm.js";

/** @param {import("../shell/shell.js").StepProperties} properties */
export function Study({ state }) {
  const studies = useStudies(state);
  const { study, list } = studies;
  return html`<section tabindex="-1">
    <h1>Study</h1>
    <${ChooseStudy} studies=${studies} />
    ${list?.length === 0 && html`<p>There is no study yet.</p>`}
    ${study && html`<article class="card" aria-label=${study.title}>
      <h2>${study.title}</h2>
      <${Facts} facts=${[
        ["Participants", study.participants.length],
        ["Sessions", study.sessions.length],
        ["Trials accepted", study.accepted],
        ["Protocol", study.protocol.fields.name],
      ]} />
      ${study.accepted === 0
        ? html`<p>The report compares the conditions once trials are accepted.</p>`
        : html`<div class="row"><a class="button" href=${report_of(study.folder)} target="_blank" rel="noopener">Open the study's report</a></div>`}
      <${Note} verdict="none" text=${`The study is the folder ${study.path}. Its trials can be exported, and compared in other ways, on the command line.`} />
    </article>`}
  </section>`;
}
