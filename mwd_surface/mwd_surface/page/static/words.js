// Texts of the page in the chosen language, from the one catalogue of the surface unit (mwd_surface/language).
//
// The function t translates texts of the page's own files. The function say translates sentences that the surface unit sends; they
// arrive in English, like all messages and logs. Both return the English text if the catalogue has no translation.

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

// Load the font of Chinese characters if a text contains them. Chromium draws boxes while a font loads and keeps them afterwards.
// Therefore the page sets its texts after the font has loaded, and the name of the well, which can come later, once again.
const WAIT = 5000; // ms
export const withFont = (text) => (!/[\u2e80-\uffef]/.test(text || "") ? Promise.resolve() : Promise.race([
  document.fonts.load('1em "Noto Sans SC Subset"', "中").catch(() => null), new Promise((done) => { setTimeout(done, WAIT); }),
]));
await withFont([...entries.values()].join(""));

// A number with the decimal mark of the language; `text`: the number with a decimal point.
export const decimal = (text) => (table.decimal === "." ? text : text.replace(".", table.decimal));

const filled = (text, values) => text.replace(/\{(\w+)\}/g, (all, name) => (name in values ? values[name] : all));

// Translation of a text of the page: a plain text, or a template literal. The catalogue contains templates with {0}, {1} for the values.
export function t(text, ...values) {
  if (typeof text === "string") return entries.get(text) || text;
  const english = text.reduce((all, part, k) => `${all}{${k - 1}}${part}`);
  return filled(entries.get(english) || english, values);
}

// Templates of the sentences that the surface unit sends: fixed parts, names of the values between them, and translation.
const letters = (text) => (text.match(/\p{L}/gu) || []).length;
const templates = [...entries].filter(([english]) => /\{[a-z]\w*\}/.test(english)).map(([english, translated]) => {
  const parts = english.split(/\{\w+\}/);
  const fixed = parts.reduce((a, b) => (b.length > a.length ? b : a));
  return { parts, names: english.match(/\{\w+\}/g).map((name) => name.slice(1, -1)), translated, fixed, known: letters(parts.join("")) };
}).sort((a, b) => b.known - a.known); // templates with the most fixed letters first
// Templates that contain "; ", which also joins sentences.
const joined = templates.filter(({ parts }) => parts.some((part) => part.includes("; ")));

// Values that fill a template in a text; null if the text does not match the template. The fixed parts are searched once, from the left
// or, if `last` is true, from the right: the results differ if a value contains a fixed part.
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
// Marks that join sentences and lists.
const MARKS = ["; ", ": ", ", ", " or ", " and ", " · "];
// Values that people have typed; they stay as typed.
const TYPED = new Set(["name", "name1", "name2", "operator", "operator_name", "because", "plan", "well", "wellbore", "path", "file", "logo"]);
const DEPTH = 6;
const JOINED = 3; // largest number of pieces of one sentence between "; " marks
// Smallest number of fixed letters with which a template may match if its values have no translation; LEAST_BEHIND applies to a
// template that begins with a value.
const LEAST = 4;
const LEAST_BEHIND = 6;
const WORK = 80000; // largest number of letters to search for one sentence
const EACH = 100; // letters counted for each search in addition to the length of its text
const KEPT = 2000; // number of translated sentences that are stored
let kept = new Map();

// Values that fill a template in a text: one set, two if the search from the right differs, none if the text does not match.
function readings(template, text) {
  const first = matched(template, text, false);
  const other = template.parts.length > 2 ? matched(template, text, true) : null;
  const same = first && other && template.names.every((name) => first[name] === other[name]);
  return [first, same ? null : other].filter(Boolean);
}

// Search for the translation of one text, with limited work. search: results so far, and remaining number of letters to search.
// whole: whether the text is one sentence, not a list of sentences.
function read(text, depth, search, whole = false) {
  const exact = entries.get(text);
  if (exact) return { text: exact, unknown: 0, known: Infinity };
  if (QUANTITY.test(text)) return { text: decimal(text).replace(/ deg$/, "°").replace(/ sigma/, "σ"), unknown: 0, known: 0 };
  // A single letter is the name of an axis.
  const unread = { text, unknown: text.length > 1 ? letters(text) : 0, known: 0 };
  if (!unread.unknown || !depth) return unread;
  const key = `${depth}${whole}${text}`;
  if (!search.read.has(key)) {
    // For a whole sentence that contains "; ", only the few templates in `joined` are searched, so this is not counted.
    search.work -= whole ? 0 : text.length + EACH;
    if (search.work < 0) return unread;
    const best = byTemplate(whole ? joined : templates, text, depth, unread, search);
    search.read.set(key, best.unknown && !whole ? byParts(text, depth, best, search) : best);
  }
  return search.read.get(key);
}

// Translation by the template that leaves the fewest letters unknown; among equal ones, by the template with the most fixed letters.
function byTemplate(among, text, depth, unread, search) {
  let best = unread;
  for (const template of among.filter(({ fixed }) => text.includes(fixed))) {
    for (const found of readings(template, text)) {
      const values = {};
      let unknown = 0;
      for (const [name, value] of Object.entries(found)) {
        const part = !TYPED.has(name) ? read(value, depth - 1, search) : { text: value, unknown: template.known < LEAST ? letters(value) : 0 };
        values[name] = part.text;
        unknown += part.unknown;
      }
      // A short template, such as "{a} is {b}", matches many texts by chance: do not use it if its values are unknown too.
      if (unknown && template.known < (template.parts[0] ? LEAST : LEAST_BEHIND)) continue;
      if (unknown < best.unknown || (unknown === best.unknown && template.known > best.known)) {
        best = { text: filled(template.translated, values), unknown, known: template.known };
      }
      if (!unknown) return best;
    }
  }
  return best;
}

// Translation of a list. If one member is unknown, the text is not a list (but, for example, a name): return `best`.
function byParts(text, depth, best, search) {
  for (const mark of MARKS.filter((one) => text.includes(one))) {
    const members = listed(mark, text.split(mark), depth - 1, search);
    if (members) return { text: members.join(entries.get(mark) || mark), unknown: 0, known: 0 };
  }
  return best;
}

// Translated members of a list; null if it is not a list. A member that is a sentence may itself contain the mark.
function listed(mark, pieces, depth, search) {
  if (!pieces.length) return [];
  for (let count = 1; count <= Math.min(pieces.length, mark === "; " ? JOINED : 1); count++) {
    const member = read(pieces.slice(0, count).join(mark), depth, search, count > 1);
    const rest = member.unknown ? null : listed(mark, pieces.slice(count), depth, search);
    if (rest) return [member.text, ...rest];
  }
  return null;
}

// A sentence of the surface unit, translated to the language of the page; an empty text for null.
export function say(text) {
  if (!text) return "";
  const english = String(text);
  if (!entries.size) return english;
  if (!kept.has(english)) {
    if (kept.size >= KEPT) kept = new Map();
    kept.set(english, read(english, DEPTH, { read: new Map(), work: WORK }).text);
  }
  return kept.get(english);
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

// Translate the texts of the HTML file.
document.documentElement.lang = table.code.replace("_", "-");
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const text = walker.currentNode.nodeValue.trim();
  if (text) walker.currentNode.nodeValue = t(text);
}
for (const name of ["aria-label", "title"]) {
  for (const element of document.body.querySelectorAll(`[${name}]`)) element.setAttribute(name, t(element.getAttribute(name)));
}
