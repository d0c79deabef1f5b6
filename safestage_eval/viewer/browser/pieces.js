// Pieces of data: in the page, in files beside it, or from a server; each is loaded when it is asked for.

const asked = new Map();    // name -> promise of its bytes
const waiting = new Map();  // name -> what to do with its text when its script comes

globalThis.safestagePiece = (name, text) => waiting.get(name)?.(text);

async function inflated(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

function scripted(source, name) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    const gone = () => { script.remove(); waiting.delete(name); };
    waiting.set(name, (text) => { gone(); resolve(text); });
    script.addEventListener("error", () => {
      gone();
      const live = document.body.dataset.carried === "live";
      reject(new Error(live ? `${source} did not come: is “safestage view” still running?`
        : `${source} is missing beside this page`));
    });
    script.addEventListener("load", () => {
      if (waiting.has(name)) { gone(); reject(new Error(`${source} is not what it should be`)); }
    });
    script.src = source;
    document.head.append(script);
  });
}

async function loaded(name, fresh) {
  const inside = document.getElementById(`piece-${name}`);
  const text = inside ? inside.textContent : await scripted(`data/${name}.js${fresh ? `?${Date.now()}` : ""}`, name);
  return inflated(text);
}

/** The bytes of a piece; with `fresh` it is asked for once more. */
export function piece(name, fresh = false) {
  if (fresh) asked.delete(name);
  if (!asked.has(name)) {
    const promise = loaded(name, fresh);
    asked.set(name, promise);
    promise.catch(() => asked.delete(name));
    const [oldest] = asked.keys();
    if (asked.size > 40) asked.delete(oldest);
  }
  return asked.get(name);
}

/** A piece that is JSON. */
export async function jsonPiece(name, fresh = false) {
  return JSON.parse(new TextDecoder().decode(await piece(name, fresh)));
}

const libraries = new Map();

async function inserted(name) {
  const script = document.createElement("script"), inside = document.getElementById(`piece-lib-${name}`);
  if (inside) {
    script.textContent = new TextDecoder().decode(await inflated(inside.textContent));
    document.head.append(script);
    return;
  }
  await new Promise((resolve, reject) => {
    script.addEventListener("load", resolve);
    script.addEventListener("error", () => reject(new Error(`lib/${name}.min.js is missing beside this page`)));
    script.src = `lib/${name}.min.js`;
    document.head.append(script);
  });
}

/** Load "three" (as THREE) or "uplot" (as uPlot), once. */
export function library(name) {
  if (!libraries.has(name)) {
    const promise = inserted(name);
    libraries.set(name, promise);
    promise.catch(() => libraries.delete(name));
  }
  return libraries.get(name);
}
