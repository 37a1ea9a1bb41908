/** Everything in one file: `npm run build` writes the page without its data to the Python package, or to another path. */

import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const output = process.argv[2] ?? join(here, "../src/gash_jax/apps/viewer/page.html");
const source = (name) => readFileSync(join(here, "src", name), "utf8");

/** The licences that three's reader of .exr files carries in plain comments, which a bundler would leave out. */
function notices() {
  const reader = readFileSync(join(here, "node_modules/three/examples/jsm/loaders/EXRLoader.js"), "utf8");
  const lines = reader.slice(reader.indexOf("// Referred to"), reader.indexOf("// End of OpenEXR license")).split("\n");
  const text = lines.map((line) => line.replace(/^[ /*-]+/, "").trimEnd()).filter(Boolean);
  if (text.length < 30) throw new Error("EXRLoader.js has no notices where they were: look where they are now");
  return `/*!\n${text.join("\n")}\n*/`;
}

async function bundled(name, options) {
  const entry = join(here, "src", name);
  const result = await build({
    entryPoints: [entry],
    bundle: true,
    minify: true,
    write: false,
    charset: "utf8",
    target: "es2022",
    ...options,
  });
  return result.outputFiles[0].text.trim();
}

// a closing tag inside the script would end it
const script = (
  await bundled("main.js", { format: "esm", legalComments: "inline", banner: { js: notices() } })
).replaceAll("</script", "<\\/script");
const parts = { style: await bundled("style.css", {}), script };
const page = source("page.html").replace(/\{\{(style|script)\}\}/g, (_, name) => parts[name]);
writeFileSync(output, page);
console.log(`wrote ${output}, ${Math.round(page.length / 1024)} KiB`);
