import js from "@eslint/js";
import globals from "globals";

export default [
  js.configs.recommended,
  { files: ["vdfmu/**/*.js"], languageOptions: { globals: globals.browser } },
  { files: ["vdfmu/**/master.js"], languageOptions: { globals: globals.worker } },
  { files: ["requirements/**/*.mjs"], languageOptions: { globals: globals.node } },
];
