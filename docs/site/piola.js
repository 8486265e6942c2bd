// Colours of piola's text, and prompts of consoles, for the highlight.js that mdBook brings.
// docs/site/build puts editors/words.json before this, as `words`.
"use strict";
(() => {
    const all = (tree) => (Array.isArray(tree) ? tree : Object.values(tree).flatMap(all));
    const list = (...names) => names.flatMap((name) => all(words[name])).join(" ");

    hljs.registerLanguage("piola", () => ({
        aliases: ["piola-error", "piola-lint"],
        keywords: {
            keyword: list("keywords"),
            built_in: list("functions", "heads") + " " + words.greek.psi,
            literal: list("constants", "weights"),
            variable: list("measures", "parts"),
        },
        // Greek letters are letters.
        lexemes: /[A-Za-z_\u0370-\u03ff\u00b5][\w\u0370-\u03ff\u00b5]*/,
        contains: [
            hljs.HASH_COMMENT_MODE,
            { className: "string", begin: /"/, end: /"|$/ },
            { className: "title", begin: /^ *potential +/, excludeBegin: true, end: /(?=\s)|$/ },
            // A unit goes on to the comma, the text, or the end of its line; a domain has brackets.
            { className: "type", begin: /\bin +(?=[\w\u00b5])/, excludeBegin: true, end: /(?=[,"#])|$/ },
            { className: "number", begin: /\b\d+(\.\d+)?([eE][+-]?\d+)?\b/ },
        ],
    }));
    hljs.registerLanguage("console", () => ({
        contains: [{ className: "meta", begin: /^\$ /, starts: { end: /$/, subLanguage: "bash" } }],
    }));

    // mdBook has coloured the page before it comes here, and spans would stay. Recordings end in an empty line.
    const ours = "code.language-console, code.language-piola, code[class*='language-piola-']";
    document.querySelectorAll(ours).forEach((block) => {
        block.textContent = block.textContent.trimEnd();
        hljs.highlightBlock(block);
    });

    // Browsers break 1e-13 behind its e-.
    const number = (cell) => /^[-+\d.e]+$/.test(cell.textContent);
    [...document.querySelectorAll("td")].filter(number).forEach((cell) => (cell.style.whiteSpace = "nowrap"));
})();
