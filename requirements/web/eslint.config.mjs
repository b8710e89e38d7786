import js from "@eslint/js";
import globals from "globals";

export default [
  js.configs.recommended,
  { rules: { "no-unused-vars": ["error", { argsIgnorePattern: "^_" }] } },
  { files: ["vdfmu/**/*.js"], languageOptions: { globals: globals.browser } },
  { files: ["vdfmu/**/master.js"], languageOptions: { globals: globals.worker } },
  { files: ["requirements/**/*.mjs"], languageOptions: { globals: globals.node } },
];
