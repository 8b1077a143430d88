// Bundles the libraries of the pages, with their licences, into the package:  npm ci && npm run build
import { build } from "esbuild";
import { copyFileSync, mkdirSync, readFileSync } from "node:fs";

const out = new URL("../../src/torquebench/report/web/libraries/", import.meta.url).pathname;
const from = new URL("node_modules/", import.meta.url).pathname;
const { version } = JSON.parse(readFileSync(`${from}three/package.json`));
mkdirSync(out, { recursive: true });
await build({
  entryPoints: ["three.mjs"], outfile: `${out}three.js`, bundle: true, minify: true, format: "iife", globalName: "THREE",
  target: "es2022", legalComments: "none", charset: "ascii",
  banner: { js: `/*! three.js ${version}, MIT, https://threejs.org */` },
});
copyFileSync(`${from}three/LICENSE`, `${out}three.LICENSE`);
copyFileSync(`${from}uplot/dist/uPlot.iife.min.js`, `${out}uplot.js`);
copyFileSync(`${from}uplot/dist/uPlot.min.css`, `${out}uplot.css`);
copyFileSync(`${from}uplot/LICENSE`, `${out}uplot.LICENSE`);
