// Renders /openapi.json for people.
"use strict";

const make = (tag, text, more = {}) => Object.assign(document.createElement(tag), text === undefined ? {} : { textContent: text }, more);

// A schema in a few words: names of schemas stay names.
function words(schema) {
  if (!schema) return "";
  if (schema.$ref) return schema.$ref.split("/").pop();
  if (schema.oneOf) return schema.oneOf.map(words).join(" | ");
  if (schema.allOf) return schema.allOf.map(words).join(" & ");
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(" | ");
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  const type = [schema.type ?? "any"].flat().join(" | ");
  if (type.startsWith("array")) return `${words(schema.items) || "any"}[]${type.includes("null") ? " | null" : ""}`;
  if (type === "object" && schema.properties) return `{ ${Object.keys(schema.properties).join(", ")} }`;
  const range = [schema.minimum !== undefined ? `≥ ${schema.minimum}` : "", schema.maximum !== undefined ? `≤ ${schema.maximum}` : ""].filter(Boolean).join(", ");
  return range ? `${type} (${range})` : type;
}

function table(heads, rows) {
  const element = make("table");
  const head = make("tr");
  head.append(...heads.map((text) => make("th", text)));
  element.append(head, ...rows.map((cells) => {
    const row = make("tr");
    row.append(...cells.map((cell) => (cell instanceof Node ? cell : make("td", cell))));
    return row;
  }));
  const box = make("div", undefined, { className: "scroll" });
  box.append(element);
  return box;
}

const code = (text) => { const cell = make("td"); cell.append(make("code", text)); return cell; };

function bodies(content) {
  return Object.entries(content ?? {}).map(([kind, body]) => [code(kind), words(body.schema)]);
}

function operation(method, path, spec) {
  const element = make("details");
  const summary = make("summary");
  summary.append(make("span", method.toUpperCase(), { className: "method" }), make("code", path), make("span", spec.summary ?? "", { className: "soft" }));
  const inner = make("div");
  if (spec.description && spec.description !== spec.summary) inner.append(make("p", spec.description));
  if (spec.parameters?.length) {
    inner.append(make("p", "Parameters", { className: "soft" }), table(["name", "in", "type", ""], spec.parameters.map((p) => [code(p.name), p.in, words(p.schema), p.description ?? ""])));
  }
  if (spec.requestBody) inner.append(make("p", "Body", { className: "soft" }), table(["media type", "what"], bodies(spec.requestBody.content)));
  inner.append(make("p", "Answers", { className: "soft" }));
  for (const [status, response] of Object.entries(spec.responses)) {
    inner.append(make("p", `${status}: ${response.description}`), table(["media type", "what"], bodies(response.content)));
  }
  element.append(summary, inner);
  return element;
}

function schema(name, spec) {
  const element = make("details", undefined, { id: name });
  const summary = make("summary");
  summary.append(make("code", name), make("span", spec.description ?? "", { className: "soft" }));
  const inner = make("div");
  if (spec.properties) {
    const needed = new Set(spec.required ?? []);
    inner.append(table(["field", "type", ""], Object.entries(spec.properties).map(([field, type]) => [code(needed.has(field) ? field : `${field}?`), words(type), type.description ?? ""])));
  } else {
    inner.append(make("pre", words(spec)));
  }
  element.append(summary, inner);
  return element;
}

async function begin() {
  const spec = await (await fetch("/openapi.json")).json();
  const main = document.getElementById("docs");
  const intro = make("section");
  intro.append(make("h2", `${spec.info.title} ${spec.info.version}`), make("p", spec.info.description));
  const groups = new Map();
  for (const [path, methods] of Object.entries(spec.paths)) {
    for (const [method, operationSpec] of Object.entries(methods)) {
      const tag = operationSpec.tags?.[0] ?? "other";
      if (!groups.has(tag)) groups.set(tag, []);
      groups.get(tag).push(operation(method, path, operationSpec));
    }
  }
  const sections = [...groups].map(([tag, operations]) => {
    const section = make("section");
    section.append(make("h2", tag), ...operations);
    return section;
  });
  const messages = make("section");
  messages.append(make("h2", "Messages"), ...Object.entries(spec.components.schemas).map(([name, body]) => schema(name, body)));
  main.replaceChildren(intro, ...sections, messages);
}

begin().catch((error) => document.getElementById("docs").replaceChildren(make("p", error.message, { className: "bad" })));
