/** The live picture of a camera in set-up mode, with what the box found in it drawn over it. */

import { of_box } from "../desk/requests.js";
import { html, useEffect, useRef } from "../vendor/preact-htm.js";

/** After a failure it is tried again. */
const AGAIN_MS = 500;

const NO_CONTENT = 204;

/**
 * One picture is fetched at a time: a slow link gets fewer pictures, and never old ones.
 *
 * @param {{box: string, aim: import("../desk/wire.js").Aim, children?: unknown}} properties
 */
export function Picture({ box, aim, children }) {
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  const wanted = useRef(aim.picture);
  wanted.current = aim.picture;
  const wake = useRef(() => {});
  useEffect(() => {
    let is_over = false;
    const changed = () => new Promise((resolve) => (wake.current = () => resolve(undefined)));
    const follow = async () => {
      for (let shown = 0; !is_over; ) {
        if (wanted.current === shown || wanted.current === 0) {
          await changed();
          continue;
        }
        const number = wanted.current;
        try {
          const answer = await fetch(`${of_box(box, "picture.jpeg")}?number=${number}`);
          if (!answer.ok) throw new Error(answer.statusText);
          if (answer.status === NO_CONTENT) {
            // Set-up mode has ended meanwhile.
            shown = number;
            continue;
          }
          const picture = await createImageBitmap(await answer.blob());
          paint(canvas.current, picture, number);
          picture.close();
          shown = number;
        } catch {
          await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
        }
      }
    };
    void follow();
    return () => {
      is_over = true;
      wake.current();
    };
  }, [box]);
  useEffect(() => wake.current(), [aim.picture]);
  const [width, height] = aim.picture_px;
  return html`<div class="picture">
    <canvas ref=${canvas} width=${width || 640} height=${height || 480} role="img"
      aria-label=${aim.picture ? "What the camera sees" : "There is no picture yet"}></canvas>
    ${children}
  </div>`;
}

/** @param {HTMLCanvasElement | null} canvas @param {ImageBitmap} picture @param {number} number */
function paint(canvas, picture, number) {
  if (!canvas) return;
  canvas.dataset.picture = String(number);
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d")?.drawImage(picture, 0, 0);
}
