// Asks the server, and says what is wrong in a person's words.

import { say } from "./sending.js";

const PATIENCE = 35000; // ms
const AGAIN = 300; // ms between two looks at a job
const GONE = "The set-up does not answer. Does `companion setup` still run?";

// content: posted as JSON; without it the path is read. Resolves to {answer} or {problem}.
export async function ask(path, content) {
  const posted = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) };
  try {
    const response = await fetch(path, { signal: AbortSignal.timeout(PATIENCE), ...(content === undefined ? {} : posted) });
    const text = await response.text();
    const told = response.headers.get("content-type")?.startsWith("application/json") ? JSON.parse(text) : { problem: text.trim() };
    return response.ok ? { answer: told } : { problem: told.problem };
  } catch {
    return { problem: GONE };
  }
}

// Starts a job, and waits for its end. wait: called with its seconds so far.
export async function job(name, content = {}, wait = () => {}) {
  let { answer, problem } = await ask(`/job/${name}`, content);
  while (!problem && answer.state === "running") {
    wait(answer.seconds ?? 0);
    await new Promise((done) => setTimeout(done, AGAIN));
    ({ answer, problem } = await ask(`/job/${name}.json`));
  }
  problem ??= answer.problem;
  if (problem) say(problem);
  return problem ? { problem } : { answer: answer.result };
}
