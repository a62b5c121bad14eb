// Posts what an operator answers.

import { PATIENCE } from "./stream.js";

// whom: who does not answer when nothing does, for a person. Returns what posts: it resolves to "" or to what is wrong, which it says, too.
export const poster = (whom) => async (kind, content) => {
  try {
    const answer = await fetch(`/${kind}`, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(content),
      signal: AbortSignal.timeout(PATIENCE),
    });
    const text = await answer.text();
    if (answer.ok) return "";
    const problem = answer.headers.get("content-type")?.startsWith("application/json") ? JSON.parse(text).problem : text.trim();
    say(problem);
    return problem;
  } catch {
    const problem = `It is not known whether that was sent: ${whom}`;
    say(problem);
    return problem;
  }
};

// Read aloud by a screen reader.
export function say(text) {
  const part = document.getElementById("say");
  part.replaceChildren(part.textContent === text ? `${text}\u00a0` : text);
}
