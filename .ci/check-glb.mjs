// Does the Khronos validator find our glTF files valid? Usage: node check-glb.mjs FILE...
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";

const validator = createRequire(process.cwd() + "/")("gltf-validator");
let failed = 0;
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), {
    maxIssues: 20,
    externalResourceFunction: async (uri) => new Uint8Array(readFileSync(join(dirname(path), decodeURIComponent(uri)))),
  });
  const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
  console.log(`${path}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos, ${numHints} hints`);
  for (const message of messages) console.log(`  ${message.pointer}: ${message.message}`);
  if (numErrors > 0 || numWarnings > 0) failed += 1;
}
console.log(`${process.argv.length - 2 - failed} passed, ${failed} failed`);
process.exit(failed > 0 ? 1 : 0);
