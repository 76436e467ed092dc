/** What is measured now: both trunk points from above and over time, and their figures so far. */

import { keep_drawn } from "../draw/canvas.js";
import { TAIL_S, plane } from "../draw/plane.js";
import { SPAN_S, strips } from "../draw/strips.js";
import { BoxAct } from "../parts/box.js";
import { Drawing, Note } from "../parts/elements.js";
import { html, useMemo } from "../vendor/preact-htm.js";
import { counted, number } from "../words.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../draw/live.js").LiveFrames} LiveFrames */

/** @param {{box: BoxState, live: LiveFrames}} properties */
export function LiveView({ box, live }) {
  const { samples } = live;
  const [keep_plane, keep_strips] = useMemo(
    () => [plane, strips].map((make) => {
      const draw = make(samples);
      return (/** @type {HTMLCanvasElement} */ canvas) => keep_drawn(canvas, () => samples.version, draw);
    }),
    [samples],
  );
  const now = box.live;
  if (!now) return html`<p class="soft">Nothing is measured at present.</p>`;
  const missing = /** @type {const} */ (["upper", "lower"]).filter((point) => now[point].missing);
  return html`<div class="stack">
    <div class="live">
      <figure>
        <${Drawing} keep=${keep_plane} name="plane" label="Both trunk points from above; the figures are in the table below" />
        <figcaption>From above, the last ${TAIL_S} s; shade: where the point lies at 95 %</figcaption>
      </figure>
      <figure>
        <${Drawing} keep=${keep_strips} name="strips" label="Both trunk points forward, to the right and upward over time; the figures are in the table below" />
        <figcaption>AP forward, ML to the right, SI upward, mm, the last ${SPAN_S} s; grey: not measured</figcaption>
      </figure>
    </div>
    ${missing.map((point) => html`<${Note} key=${point} verdict="warn" text=${`The ${point} trunk is not seen: ${now[point].missing}`} />`)}
    <div class="scroll" tabindex="0" role="region" aria-label="Figures so far"><${Figures} now=${now} /></div>
    <div class="row apart small">
      <span class="soft">${measured_words(now, live)}</span>
      <${BoxAct} box=${box} needs="reference" action="reference" kind="plain">Draw from here<//>
    </div>
  </div>`;
}

/** @param {{now: NonNullable<BoxState["live"]>}} properties */
function Figures({ now }) {
  return html`<table class="figures">
    <caption class="unseen">Figures so far</caption>
    <thead><tr><th scope="col">Trunk</th><th scope="col" class="number">RMS AP, mm</th><th scope="col" class="number">RMS ML, mm</th>
      <th scope="col" class="number">Path, mm</th><th scope="col" class="number">of noise alone, mm</th><th scope="col" class="number">Gaps</th><th scope="col" class="number">in</th></tr></thead>
    <tbody>${/** @type {const} */ (["upper", "lower"]).map((point) => {
      const { figures, not_yet } = now[point];
      const name = html`<th scope="row"><span class="key-of ${point}"></span>${point}</th>`;
      if (!figures) return html`<tr key=${point}>${name}<td colspan="6" class="soft">${not_yet}</td></tr>`;
      const { rms_mm, path_mm, noise_path_mm, gaps, span_s } = figures;
      return html`<tr key=${point}>
        ${name}
        <td class="number">${number(rms_mm[0], 2)}</td>
        <td class="number">${number(rms_mm[1], 2)}</td>
        <td class="number">${number(path_mm, 1)}</td>
        <td class="number">${number(noise_path_mm, 1)}</td>
        <td class="number">${gaps}</td>
        <td class="number">${number(span_s, 0, "s")}</td>
      </tr>`;
    })}</tbody>
  </table>`;
}

/** @param {NonNullable<BoxState["live"]>} now @param {LiveFrames} live */
function measured_words(now, live) {
  // While a trial is recorded the desk counts in words.
  const counts = now.counts.length > 0 ? now.counts : [`${number(now.rate_hz, 1)} Hz`, `${now.lost} lost`];
  const words = [
    ...counts,
    now.screen_ms && `exposure to screen ${number(now.screen_ms[0], 0, "ms")} (at most ${number(now.screen_ms[1], 0, "ms")})`,
    live.dropped > 0 && `${counted(live.dropped, "frame")} not drawn here, because this page was too slow; the recording has them`,
  ];
  return words.filter(Boolean).join(" · ");
}
