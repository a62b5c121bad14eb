// Proposes a word's weight, and says which words an answer turns. `companion/wire/words_text.py` says the same. Pure.

import { capital, signed } from "./wording.js";

// A word as the rover stores it.
export const plain = (word) => word.trim().replace(/\s+/g, " ").toLowerCase().normalize("NFC");

// of: word -> its own weight: in force, else as it was given last. read: whether no other word has one.
// rover: {words, given, names}, as cards have it; given: null until it was read.
export function ownWeights({ words, given, names = [] }) {
  const used = words.filter(({ weight }) => weight !== null).map(({ word, weight }) => [word, weight]);
  return { of: new Map([...[...names].reverse(), ...Object.entries(given ?? {}), ...used]), read: Boolean(given) };
}

// typed: the weight that somebody chose, null for none. own: as of `ownWeights`. thing: whether the word is for a thing.
export function propose(word, typed, own, thing) {
  const was = own.of.get(plain(word)) ?? null;
  const weight = typed ?? was ?? (thing ? -1 : 1);
  return { weight, was, turns: was === null ? !own.read : was > 0 !== weight > 0 };
}

// The words among these changes that turn their sign, each with what it was and what then becomes drivable or not.
export function turned(changes, own) {
  return changes.filter(({ weight }) => weight !== undefined).map(({ word, tap, weight }) => ({ word: word ?? tap, ...propose(word ?? tap, weight, own) }))
    .filter(({ turns }) => turns);
}

export const turnText = ({ word, was, weight }) => `${was === null ? `What weight ${word} has is not read yet` : `${capital(word)} was ${signed(was)}`}. All that fits it becomes ${weight > 0 ? "drivable" : "not drivable"}.`;
