/** Before anything is shown, whoever opens the page is signed in. */

import { Act, Field } from "../parts/elements.js";
import { html, useState } from "../vendor/preact-htm.js";

/** @param {{greeting: import("../desk/connection.js").Greeting, sign_in: (password: string) => Promise<void>}} properties */
export function SignIn({ greeting, sign_in }) {
  const [password, set_password] = useState("");
  if (greeting.sign_in === "token") {
    return html`<section class="card">
      <h1>This page is not signed in</h1>
      <p>Open the address that the desk has printed when it was started: it holds what signs you in.</p>
    </section>`;
  }
  return html`<section class="card">
    <h1>Sign in to the desk</h1>
    <form class="stack" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
      <${Field} label="Password" kind="password" value=${password} set=${set_password} autocomplete="current-password" />
      <div class="row"><${Act} kind="first" type="submit" act=${() => sign_in(password)}>Sign in<//></div>
    </form>
  </section>`;
}
