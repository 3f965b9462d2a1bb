"use strict";
/* The page asks its server what to show, and sends what was dropped, corrected or filled in. Names out of files are set as text. */

const SECTIONS = ["start", "looking", "found", "running", "done", "ended"];
const STEPS = { start: 1, receiving: 1, looking: 2, found: 2, running: 3, done: 4, ended: 4 };
const MOVEMENTS = {
  "": "not known", standing: "standing", walking: "walking", running: "running", jumping: "jumping", squatting: "squatting",
  rising: "rising from a seat", stairs: "stairs", "upper limb": "arm movement", other: "another movement",
};
const EVERY = 400;
const ANOTHER = "another";
let state = null;
let shown = "";
let asking = false;
let sending = null;
let filled = "";
let people = []; // As found, and whom the user adds.

const byId = (name) => document.getElementById(name);

function made(tag, values = {}, ...inside) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(values)) {
    if (name === "class") node.className = value;
    else if (name in node && name !== "list") node[name] = value;
    else node.setAttribute(name, value);
  }
  node.append(...inside.filter((one) => one !== null && one !== undefined && one !== ""));
  return node;
}

async function ask(path, said, method = "POST") {
  const options = method === "GET" ? {} : { method, headers: { "Content-Type": "application/json" }, body: JSON.stringify(said || {}) };
  let answer;
  try {
    answer = await fetch(path, options);
  } catch (error) {
    throw new Error("Myomorph does not answer: it was closed. Start it again.");
  }
  const told = await answer.json();
  if (!answer.ok) throw new Error(told.error || `no answer (${answer.status})`);
  return told;
}

async function act(path, said) {
  try {
    complain("");
    show(await ask(path, said));
  } catch (error) {
    complain(error.message);
  }
}

function complain(text) {
  const box = byId("error");
  box.querySelector("p").textContent = text;
  box.hidden = !text;
  if (text) box.scrollIntoView({ block: "nearest" });
}

async function look() {
  if (asking || sending) return;
  asking = true;
  try {
    show(await ask("state", null, "GET"));
  } catch (error) {
    if (shown !== "ended") complain(error.message);
  } finally {
    asking = false;
  }
}

function show(told) {
  const before = state;
  state = told;
  const phase = sending ? "looking" : told.phase;
  byId("version").textContent = `Version ${told.version}`;
  byId("home").textContent = told.home;
  byId("folder").placeholder = told.home.includes("\\") ? "C:\\Users\\Anna\\walks" : "/Users/Anna/walks";
  if (told.error && (!before || before.error !== told.error)) complain(told.error);
  turnTo(phase === "receiving" ? "looking" : phase);
  if (phase === "looking" || phase === "receiving") showReading();
  if (phase === "running") showRunning();
  if (phase === "done") {
    showDone();
    if (before && before.phase === "running" && told.done.open) location.assign(placeOf(told.done.open));
  }
  // What was filled in stays until other recordings are looked at.
  if (phase === "looking") filled = "";
  if (phase === "found" && filled !== told.found.source) {
    filled = told.found.source;
    showFound();
  }
}

function turnTo(name) {
  if (shown === name) return;
  shown = name;
  for (const one of SECTIONS) byId(one).hidden = one !== name;
  for (let number = 1; number <= 4; number += 1) {
    const step = byId(`step-${number}`);
    step.classList.toggle("past", number < STEPS[name]);
    if (number === STEPS[name]) step.setAttribute("aria-current", "step");
    else step.removeAttribute("aria-current");
  }
  const title = byId(name).querySelector("h1");
  document.title = `${title.textContent} · Myomorph`;
  title.focus({ preventScroll: true });
  scrollTo(0, 0);
}

function fill(section, share) {
  const bar = byId(section).querySelector(".bar");
  const percent = Math.round(100 * share);
  bar.firstElementChild.style.width = `${percent}%`;
  bar.setAttribute("aria-valuenow", percent);
}

/* --- what is dropped ------------------------------------------------------------------------------------------ */

function showReading() {
  if (sending) {
    fill("looking", sending.total ? sending.done / sending.total : 0);
    byId("reading").textContent = `Copying ${sending.name} (${sending.number} of ${sending.count})`;
    return;
  }
  const { count = 0, total = 0, name = "" } = state.reading;
  fill("looking", total ? (count - 0.5) / total : 0.02);
  byId("reading").textContent = state.note || (name ? `${name} (${count} of ${total})` : "Opening …");
}

async function entriesOf(folder) {
  const reader = folder.createReader();
  const all = [];
  for (;;) {
    const some = await new Promise((ready, failed) => reader.readEntries(ready, failed));
    if (!some.length) return all;
    all.push(...some);
  }
}

async function filesOf(entry, before = "") {
  const path = before + entry.name;
  if (entry.isFile) {
    const file = await new Promise((ready, failed) => entry.file(ready, failed));
    return [{ path, file }];
  }
  if (entry.name.startsWith(".")) return [];
  const parts = [];
  for (const one of await entriesOf(entry)) parts.push(...(await filesOf(one, `${path}/`)));
  return parts;
}

function isRead(path) {
  const name = path.toLowerCase();
  return state.endings.some((ending) => name.endsWith(ending));
}

/* Below the folder that was dropped, whose name the server knows from the list. */
function below(files) {
  const tops = new Set(files.map((one) => one.path.split("/")[0]));
  const nested = files.every((one) => one.path.includes("/"));
  return tops.size === 1 && nested ? (path) => path.slice(path.indexOf("/") + 1) : (path) => path;
}

async function send(all) {
  if (!state || sending) return;
  if (!["start", "found", "done"].includes(state.phase)) {
    complain("Something is being computed: cancel it first, or wait.");
    return;
  }
  const files = all.filter((one) => isRead(one.path));
  if (!files.length) {
    const names = all.slice(0, 3).map((one) => one.path).join(", ");
    complain(`${names || "What was dropped"}: no recording. Expected ${state.endings.join(", ")}`);
    return;
  }
  complain("");
  const total = files.reduce((sum, one) => sum + one.file.size, 0);
  sending = { done: 0, total, number: 0, count: files.length, name: "" };
  try {
    show(await ask("drop", { files: files.map((one) => ({ path: one.path, size: one.file.size })) }));
    const place = below(files);
    for (const { path, file } of files) {
      sending.number += 1;
      sending.name = path;
      showReading();
      const answer = await fetch(`drop?path=${encodeURIComponent(place(path))}`, { method: "PUT", body: file });
      if (!answer.ok) throw new Error((await answer.json()).error);
      sending.done += file.size;
      showReading();
    }
    sending = null;
    show(await ask("look", {}));
  } catch (error) {
    sending = null;
    await ask("again").then(show, () => null);
    complain(error.message);
  }
}

function listenToDrops() {
  const area = byId("drop");
  const stop = (event) => { event.preventDefault(); };
  addEventListener("dragover", (event) => { stop(event); area.classList.add("over"); });
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) area.classList.remove("over"); });
  addEventListener("drop", async (event) => {
    stop(event);
    area.classList.remove("over");
    // Entries are gone once this function waits.
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry && item.webkitGetAsEntry()).filter(Boolean);
    const plain = [...event.dataTransfer.files].map((file) => ({ path: file.name, file }));
    const parts = [];
    try {
      for (const entry of entries) parts.push(...(await filesOf(entry)));
    } catch (error) {
      complain("The browser does not let this folder be read: name it below instead.");
      return;
    }
    await send(parts.length ? parts : plain);
  });
  for (const name of ["files", "tree"]) {
    byId(name).addEventListener("change", async (event) => {
      const files = [...event.target.files].map((file) => ({ path: file.webkitRelativePath || file.name, file }));
      event.target.value = "";
      await send(files);
    });
  }
}

/* --- a folder of this computer --------------------------------------------------------------------------------- */

async function listFolders(path) {
  const box = byId("folders");
  let told;
  try {
    complain("");
    told = await ask(`folders?path=${encodeURIComponent(path)}`, null, "GET");
  } catch (error) {
    complain(error.message);
    return;
  }
  const line = made("p", {}, made("span", { class: "path" }, told.path || "Where are the recordings?"));
  if (told.path) {
    const use = made("button", { type: "button", class: "main" }, "Take this folder");
    use.addEventListener("click", () => { box.hidden = true; byId("folder").value = told.path; act("look", { path: told.path }); });
    line.append(use);
  }
  const list = made("ul", {});
  const entries = told.path ? [{ name: "↑ one folder up", path: told.parent }, ...told.folders] : told.folders;
  for (const one of entries) {
    const button = made("button", { type: "button" }, one.name);
    button.addEventListener("click", () => listFolders(one.path));
    list.append(made("li", {}, button));
  }
  box.replaceChildren(line, list);
  box.hidden = false;
  byId("browse").setAttribute("aria-expanded", "true");
  list.querySelector("button")?.focus();
}

/* --- what was found -------------------------------------------------------------------------------------------- */

function field(label, input, hint, needed = false) {
  const small = made("small", { id: `${input.id}-hint` }, hint || "");
  input.setAttribute("aria-describedby", small.id);
  return made("div", { class: needed ? "field needed" : "field" }, made("label", { htmlFor: input.id }, label), input, small);
}

function choice(id, options, value) {
  const select = made("select", { id });
  for (const [key, words] of options) select.append(made("option", { value: key }, words));
  select.value = value;
  return select;
}

function counted(number, noun) {
  return `${number} ${noun}${number === 1 ? "" : "s"}`;
}

function personFields(person, number, trials) {
  const missing = person.mass === null;
  const mass = made("input", { id: `mass-${number}`, inputMode: "decimal", autocomplete: "off", value: missing ? "" : String(person.mass), required: true });
  const massHint = missing ? "Needed: no force plate weighs this person." : "As the force plates weigh it.";
  const height = made("input", { id: `height-${number}`, inputMode: "decimal", autocomplete: "off" });
  const age = made("input", { id: `age-${number}`, inputMode: "decimal", autocomplete: "off" });
  const name = made("input", { id: `name-${number}`, autocomplete: "off", value: person.name });
  const options = [["", "none"], ...trials.map((trial) => [String(trial.id), trial.file])];
  const still = choice(`static-${number}`, options, person.static === null ? "" : String(person.static));
  still.addEventListener("change", markStatic);
  if (person.static !== null) still.querySelector("option[value='']").remove();
  const stillHint = person.static === null ? "Not found: lengths come from the motion." : "Shows the lengths of the body.";
  const known = person.named ? `By the ${person.known.replace(/^.*\(|\)$/g, "")}.` : "Nothing in the files says who it is.";
  return made("div", { class: "fields" },
    field("Who", name, known),
    field("Body mass (kg)", mass, massHint, missing),
    field("Height (m)", height, "If you like: helps where few markers are on the trunk."),
    field("Age (years)", age, "If you like: chooses what a walk is compared with."),
    field("Standing still", still, stillHint));
}

function trialRow(trial) {
  const used = made("input", { type: "checkbox", id: `use-${trial.id}`, checked: true, "aria-label": `Compute ${trial.file}` });
  used.addEventListener("change", () => row.classList.toggle("off", !used.checked));
  const movements = Object.entries(MOVEMENTS).filter(([name]) => name || !trial.movement);
  const movement = choice(`movement-${trial.id}`, movements, trial.movement);
  movement.setAttribute("aria-label", `Movement in ${trial.file}`);
  const how = trial.how.replace(/^[^(]*\(/, "").replace(/\)$/, "");
  const warnings = trial.warnings.map((text) => made("small", {}, text));
  const file = made("td", { class: "file" }, made("label", { htmlFor: used.id }, trial.file), made("small", { class: "static", hidden: true }, "stands still: shows the body"));
  const length = [`${trial.seconds.toFixed(1)} s`, trial.rate ? made("small", {}, `${trial.rate} per second`) : ""];
  const row = made("tr", { id: `trial-${trial.id}` },
    made("td", {}, used), file,
    made("td", {}, movement, made("small", {}, trial.movement ? how : ""), ...warnings),
    made("td", { "data-name": "Length" }, ...length),
    made("td", { "data-name": "Markers" }, trial.markers ? String(trial.markers) : `${trial.sensors} sensors`),
    platesCell(trial),
    made("td", { "data-name": "Muscle signals" }, trial.emg ? String(trial.emg) : "none"),
    whoCell(trial));
  return row;
}

function platesCell(trial) {
  if (!trial.plates) return made("td", { "data-name": "Force plates" }, trial.table ? trial.table : "none");
  const box = made("input", { type: "checkbox", id: `plates-${trial.id}`, checked: true });
  return made("td", { "data-name": "Force plates" }, made("label", { class: "plates" }, box, `use ${trial.plates}`));
}

/* Who is in a recording is asked where there are several people, or may be. */
function asksWho() {
  return people.length > 1 || state.found.unresolved.length > 0;
}

function whoCell(trial) {
  if (!asksWho()) return "";
  const options = [...people.map((person, number) => [String(number), person.name]), [ANOTHER, "somebody else"]];
  const who = choice(`who-${trial.id}`, options, String(people.findIndex((one) => one.name === trial.person)));
  who.addEventListener("change", () => { if (who.value === ANOTHER) addPerson(who); });
  who.setAttribute("aria-label", `Who is in ${trial.file}`);
  return made("td", { "data-name": "Who" }, who);
}

/* A person whom nobody found: a box of fields, and a name to choose at every recording. */
function addPerson(chosen) {
  const number = people.length;
  const person = { name: `Person ${number + 1}`, known: "", named: false, kind: "person", why: "", mass: null, static: null };
  people.push(person);
  for (const who of document.querySelectorAll("[id^='who-']")) who.lastElementChild.before(made("option", { value: String(number) }, person.name));
  chosen.value = String(number);
  const boxes = document.querySelectorAll(".person");
  boxes[boxes.length - 1].after(personBox(person, number));
  byId(`mass-${number}`).focus();
}

function markStatic() {
  const chosen = new Set([...document.querySelectorAll("[id^='static-']")].map((one) => one.value).filter(Boolean));
  for (const trial of state.found.trials) {
    const row = byId(`trial-${trial.id}`);
    const still = chosen.has(String(trial.id));
    row.querySelector(".static").hidden = !still;
    row.querySelector("input[type=checkbox]").disabled = still;
  }
}

function personBox(person, number) {
  const trials = state.found.trials.filter((trial) => trial.person === person.name);
  const head = ["", "File", "Movement", "Length", "Markers", "Force plates", "Muscle signals", ...(asksWho() ? ["Who"] : [])];
  const table = made("table", { class: "trials" },
    made("thead", {}, made("tr", {}, ...head.map((text, k) => made("th", { scope: "col" }, k ? text : made("span", { class: "unseen" }, "Compute"))))),
    made("tbody", {}, ...trials.map((trial) => trialRow(trial))));
  const kind = person.kind === "animal" ? "Animal" : "Person";
  return made("fieldset", { class: "person" },
    made("legend", {}, people.length > 1 ? `${kind} ${number + 1}: ${person.name}` : kind),
    person.why ? made("p", { class: "hint" }, `Another one than before: ${person.why}.`) : "",
    personFields(person, number, trials.length ? trials : state.found.trials), trials.length ? made("div", { class: "scroll", tabindex: "0" }, table) : "");
}

function labelsBox(labels) {
  if (!labels.unknown.length) return "";
  const rows = labels.unknown.map((label, number) => {
    const proposed = labels.proposed[label];
    const input = made("input", { id: `label-${number}`, autocomplete: "off", value: proposed ? proposed.place : "", placeholder: "not used" });
    input.setAttribute("list", "landmarks");
    input.dataset.label = label;
    return made("tr", {}, made("td", {}, made("label", { htmlFor: input.id }, label)), made("td", {}, input),
      made("td", { class: "apart" }, proposed ? `${proposed.apart} cm from there on an average body` : ""));
  });
  byId("landmarks").replaceChildren(...labels.landmarks.map((words) => made("option", { value: words })));
  const box = made("details", { class: "labels", open: labels.needed },
    made("summary", {}, `Markers without a known name (${labels.count})`),
    made("p", { class: "soft" }, labels.needed
      ? "Too few markers have names that are known. Say where each one sits; proposals come from how the body stands, so look over each. With a model that has these markers nothing is needed."
      : "They are not used. Say where one sits, and it is."),
    labels.needed ? made("p", { class: "soft" }, labels.why) : "",
    made("div", { class: "scroll", tabindex: "0" }, made("table", {}, made("thead", {}, made("tr", {}, ...["Marker", "Sits on", "How near"].map((text) => made("th", { scope: "col" }, text)))), made("tbody", {}, ...rows))));
  return box;
}

function moreBox(found) {
  const out = made("input", { id: "out", autocomplete: "off", spellcheck: false, value: state.out });
  const results = field("Results go to", out, "A folder; it is made where it does not exist.");
  results.classList.add("wide");
  const parts = [results];
  if (found.arms) {
    const arms = made("input", { id: "arms", type: "checkbox" });
    parts.push(made("div", { class: "field wide" }, made("label", {}, arms, " With arms"), made("small", {}, "Markers show how they move; it takes longer.")));
  }
  const models = Object.keys(found.models);
  if (models.length) {
    const model = choice("model", [["", "average body, fitted to the markers"], ...models.map((name) => [name, name])], "");
    parts.push(field("Model", model, "A model of your own lies in the folder."));
  }
  return made("div", { class: "fields" }, ...parts);
}

function showFound() {
  const { found } = state;
  people = [...found.people];
  const protocol = found.labels.protocol ? `, markers of ${found.labels.protocol}` : "";
  const date = found.date ? `, recorded ${found.date}` : "";
  byId("summary").textContent = `${counted(found.trials.length, "recording")}${date}${protocol}. Correct what is wrong; then compute.`;
  const go = made("button", { type: "submit", class: "main" }, "Compute");
  const back = made("button", { type: "button" }, "Other recordings");
  back.addEventListener("click", () => act("again"));
  const remarks = [...found.unresolved, ...found.passed_over].map((text) => made("li", {}, text));
  byId("asked").replaceChildren(...[
    ...people.map(personBox),
    labelsBox(found.labels),
    moreBox(found),
    remarks.length ? made("details", { open: remarks.length < 3 }, made("summary", {}, counted(remarks.length, "remark")), made("ul", { class: "remarks" }, ...remarks)) : "",
    made("p", { class: "buttons" }, go, back),
  ].filter((one) => one !== ""));
  markStatic();
  const missing = document.querySelector(".field.needed input");
  if (missing) missing.focus({ preventScroll: true });
}

/* What the plates weigh and where somebody stands still is found anew, unless it was corrected. */
function askedPerson(person, number) {
  const value = (name) => byId(`${name}-${number}`).value.trim();
  const all = state.found.trials.every((trial) => trial.person !== person.name || byId(`use-${trial.id}`).checked);
  const weighed = all && person.mass !== null && value("mass") === String(person.mass);
  const still = person.static !== null && value("static") === String(person.static);
  return { name: value("name") || person.name, mass: weighed ? "" : value("mass"), height: value("height"), age: value("age"), static: still ? "" : value("static") };
}

function asked() {
  const { found } = state;
  const value = (name) => byId(name)?.value.trim() ?? "";
  const persons = people.map(askedPerson);
  const trials = found.trials.map((trial) => {
    const number = byId(`who-${trial.id}`) ? Number(value(`who-${trial.id}`)) : Math.max(0, people.findIndex((one) => one.name === trial.person));
    return {
      id: trial.id, used: byId(`use-${trial.id}`).checked, person: persons[number].name,
      movement: value(`movement-${trial.id}`), plates: byId(`plates-${trial.id}`)?.checked ?? true,
    };
  });
  const labels = {};
  for (const input of document.querySelectorAll("[id^='label-']")) if (input.value.trim()) labels[input.dataset.label] = input.value.trim();
  return { people: persons, trials, labels, out: value("out"), arms: byId("arms")?.checked ?? false, model: value("model") };
}

function firstMissing() {
  const { people: persons, trials } = asked();
  const used = new Set(trials.filter((trial) => trial.used).map((trial) => trial.person));
  const has = new Set(persons.filter((one, number) => byId(`mass-${number}`).value.trim()).map((one) => one.name));
  const number = persons.findIndex((person) => used.has(person.name) && !has.has(person.name));
  return number < 0 ? null : byId(`mass-${number}`);
}

/* --- computing, and the answer --------------------------------------------------------------------------------- */

function showRunning() {
  const { share = 0, left = "", now = [] } = state.bar;
  fill("running", share);
  byId("share").textContent = `${Math.round(100 * share)} %`;
  byId("left").textContent = left ? `about ${left} left` : state.note;
  const lines = now.length ? now : ["preparing"];
  const list = byId("now");
  if (list.textContent !== lines.join("")) list.replaceChildren(...lines.map((text) => made("li", {}, text)));
  showAssumed(byId("assumed"));
}

function showAssumed(box) {
  box.hidden = !state.assumed.length;
  const list = box.querySelector("ul");
  if (list.childElementCount !== state.assumed.length) list.replaceChildren(...state.assumed.map((text) => made("li", {}, text)));
}

function placeOf(place) {
  return `results/${place.split("/").map(encodeURIComponent).join("/")}`;
}

function showDone() {
  const { trials, others, study, out } = state.done;
  const failed = trials.filter((trial) => trial.error).length;
  byId("outcome").textContent = failed ? `${trials.length - failed} of ${trials.length} recordings could be computed.` : `${counted(trials.length, "recording")}, all computed.`;
  byId("where").textContent = out;
  const link = (text, place) => made("a", { href: placeOf(place) }, text);
  const lines = trials.map((trial) => made("div", { class: trial.error ? "one bad" : "one" }, made("b", {}, trial.name),
    ...trial.pages.map((page) => link(page.text, page.place)), trial.error ? made("p", {}, trial.error) : ""));
  if (study) lines.unshift(made("div", { class: "one" }, made("b", {}, "All recordings"), link("Overview", study)));
  for (const other of others) lines.push(made("div", { class: "one bad" }, made("b", {}, other.name), made("p", {}, other.error)));
  byId("answers").replaceChildren(...lines);
}

/* --- buttons --------------------------------------------------------------------------------------------------- */

addEventListener("DOMContentLoaded", () => {
  listenToDrops();
  byId("typed").addEventListener("submit", (event) => { event.preventDefault(); act("look", { path: byId("folder").value || " " }); });
  byId("browse").addEventListener("click", () => {
    const box = byId("folders");
    if (box.hidden) listFolders(byId("folder").value.trim());
    else box.hidden = true;
    byId("browse").setAttribute("aria-expanded", String(!box.hidden));
  });
  byId("asked").addEventListener("submit", (event) => {
    event.preventDefault();
    const missing = firstMissing();
    if (missing) {
      complain("The body mass is missing: forces need it.");
      missing.focus();
      return;
    }
    act("compute", asked());
  });
  for (const button of document.querySelectorAll("[data-act]")) button.addEventListener("click", () => act(button.dataset.act));
  byId("quit").addEventListener("click", async () => {
    await ask("quit").catch(() => null);
    turnTo("ended");
    byId("quit").hidden = true;
  });
  look();
  setInterval(() => {
    if (shown === "ended") return;
    if (!state || ["receiving", "looking", "running"].includes(state.phase)) look();
  }, EVERY);
});
