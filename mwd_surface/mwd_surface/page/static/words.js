// Texts of the page in the chosen language, from the one catalogue of the surface unit (mwd_surface/language).
//
// The function t translates texts that are written in these files. The function say translates sentences of the surface unit, which
// arrive in English like every message and log. Both return English where the catalogue has no translation.

const remembered = { get: () => { try { return localStorage.getItem("language"); } catch { return null; } },
  set: (code) => { try { localStorage.setItem("language", code); } catch { /* a private window keeps nothing */ } } };

const asked = new URLSearchParams(location.search).get("lang");
if (asked) remembered.set(asked);

// code, decimal, languages: [code, name], entries: from English to the language.
let table = { code: "en", decimal: ".", languages: [], entries: {} };
try {
  const answer = await fetch(`words.json?lang=${encodeURIComponent(asked || remembered.get() || "")}`, { signal: AbortSignal.timeout(5000) });
  if (answer.ok) table = await answer.json();
} catch {
  // The page works in English without the catalogue.
}

const entries = new Map(Object.entries(table.entries));

// Writes a number with the decimal mark of the language; `text` has a point.
export const decimal = (text) => (table.decimal === "." ? text : text.replace(".", table.decimal));

const filled = (text, values) => text.replace(/\{(\w+)\}/g, (all, name) => (name in values ? values[name] : all));

// Translates a text of these files: a plain text, or a tagged template, whose values are {0}, {1} in the catalogue.
export function t(text, ...values) {
  if (typeof text === "string") return entries.get(text) || text;
  const english = text.reduce((all, part, k) => `${all}{${k - 1}}${part}`);
  return filled(entries.get(english) || english, values);
}

// Templates of the surface unit's sentences: fixed parts, names of the values between them, translation.
const letters = (text) => (text.match(/\p{L}/gu) || []).length;
const templates = [...entries].filter(([english]) => /\{[a-z]\w*\}/.test(english)).map(([english, translated]) => {
  const parts = english.split(/\{\w+\}/);
  const fixed = parts.reduce((a, b) => (b.length > a.length ? b : a));
  return { parts, names: english.match(/\{\w+\}/g).map((name) => name.slice(1, -1)), translated, fixed, known: letters(parts.join("")) };
});

// Returns the values of a template in a text; null if the text does not match. Fixed parts are found in one pass, from the left
// or, if `last`, from the right: a value may contain such a part.
function matched({ parts, names }, text, last) {
  const [head, tail] = [parts[0], parts[parts.length - 1]];
  if (text.length < head.length + tail.length || !text.startsWith(head) || !text.endsWith(tail)) return null;
  let rest = text.slice(head.length, text.length - tail.length);
  const found = [];
  const middle = parts.slice(1, -1);
  for (const part of last ? middle.reverse() : middle) {
    const at = last ? rest.lastIndexOf(part) : rest.indexOf(part);
    if (at < 0) return null;
    const [before, after] = [rest.slice(0, at), rest.slice(at + part.length)];
    found.push(last ? after : before);
    rest = last ? before : after;
  }
  found.push(rest);
  if (last) found.reverse();
  const values = {};
  for (const [k, name] of names.entries()) {
    if ((values[name] ?? found[k]) !== found[k]) return null;
    values[name] = found[k];
  }
  return values;
}

// A number with its unit, which needs no translation.
const QUANTITY = /^[+\-−]?\d[\d.,:e+\-−]*( ?(%|°|deg|nT|uT|mG|T|s|m|ft|g|dB|Hz|MB|GB|kN|bar|min|h|ppm|urad|sigma|rad\/s|m\/s\^2|deg\/h|deg\/s|r\/min))?$/;
// Separators between sentences and between the items of a list.
const MARKS = ["; ", ": ", ", ", " or ", " and ", " at ", " · "];
const DEPTH = 6;
const LEAST = 5; // least number of letters of a template whose values are not all known
const KEPT = 2000; // most sentences in the cache
let kept = new Map();

// Returns the translation of a text, and the number of its letters that no template matches.
function read(text, depth) {
  const known = kept.get(text);
  if (known) return known;
  // A single letter is the name of an axis.
  let best = { text, unknown: text.length > 1 ? letters(text) : 0, known: 0 };
  const exact = entries.get(text);
  if (exact) best = { text: exact, unknown: 0, known: Infinity };
  else if (QUANTITY.test(text)) best = { text: decimal(text).replace(/ deg$/, "°").replace(/ sigma/, "σ"), unknown: 0, known: 0 };
  else if (depth > 0 && best.unknown) {
    for (const [template, last] of templates.filter(({ fixed }) => text.includes(fixed)).flatMap((one) => [[one, false], [one, true]])) {
      const found = matched(template, text, last);
      if (!found) continue;
      const values = {};
      let unknown = 0;
      for (const [name, value] of Object.entries(found)) {
        const part = read(value, depth - 1);
        values[name] = part.text;
        unknown += part.unknown;
      }
      // A short template, such as "{a} is {b}", matches by chance. Skip it if the catalogue does not have its values.
      if (unknown && template.known < LEAST) continue;
      if (unknown < best.unknown || (unknown === best.unknown && template.known > best.known)) {
        best = { text: filled(template.translated, values), unknown, known: template.known };
      }
    }
  }
  if (depth > 0) {
    for (const mark of MARKS) {
      if (!best.unknown || !text.includes(mark)) continue;
      const pieces = text.split(mark).map((piece) => read(piece, depth - 1));
      const unknown = pieces.reduce((sum, piece) => sum + piece.unknown, 0);
      if (unknown < best.unknown) best = { text: pieces.map((piece) => piece.text).join(entries.get(mark) || mark), unknown, known: 0 };
    }
  }
  if (depth === DEPTH) {
    if (kept.size >= KEPT) kept = new Map();
    kept.set(text, best);
  }
  return best;
}

// Translates a sentence of the surface unit into the language of the page; returns an empty text for null.
export function say(text) {
  if (!text) return "";
  return entries.size ? read(String(text), DEPTH).text : String(text);
}

// Let people choose among the languages that the surface unit has.
export function chooseLanguage(select) {
  for (const [code, name] of table.languages) {
    const option = document.createElement("option");
    [option.value, option.textContent, option.lang] = [code, name, code.replace("_", "-")];
    select.append(option);
  }
  select.value = table.code;
  select.addEventListener("change", () => {
    remembered.set(select.value);
    const address = new URL(location.href);
    address.searchParams.delete("lang");
    location.replace(address);
  });
}

// Translate the texts that stand in the HTML file.
document.documentElement.lang = table.code.replace("_", "-");
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const text = walker.currentNode.nodeValue.trim();
  if (text) walker.currentNode.nodeValue = t(text);
}
for (const name of ["aria-label", "title"]) {
  for (const element of document.body.querySelectorAll(`[${name}]`)) element.setAttribute(name, t(element.getAttribute(name)));
}
