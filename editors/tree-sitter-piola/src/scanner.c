// Line ends and parentheses: outside parentheses a newline ends the statement, inside it is a blank,
// unless the next line begins as only a statement can (as `begins_statement` of grammar/src/parse/scan.rs).
// So a parenthesis that is not closed yet spoils its own statement and no other.

#include "tree_sitter/alloc.h"
#include "tree_sitter/parser.h"

#include <string.h>

// In the order of `externals` in grammar.js.
enum Token { NEWLINE, BLANK_NEWLINE, OPEN_ROUND, CLOSE_ROUND, OPEN_SQUARE, CLOSE_SQUARE };

typedef struct {
    uint16_t depth; // open parentheses
} Scanner;

static const char *const STATEMENTS[] = {
    "potential", "source",  "import", "allow", "parameter", "dimensions",
    "weights",   "domain",  "break",  "state", "update",
};

enum { LONGEST_WORD = 15 };

static bool is_greek(int32_t c) {
    return (c >= 0x0391 && c <= 0x03A1) || (c >= 0x03A3 && c <= 0x03A9) || (c >= 0x03B1 && c <= 0x03C9) ||
           c == 0x03D1 || c == 0x03D5 || c == 0x03D6 || c == 0x03F0 || c == 0x03F1 || c == 0x03F5 ||
           c == 0x00B5;
}

static bool begins_name(int32_t c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || is_greek(c);
}

static bool continues_name(int32_t c) { return begins_name(c) || (c >= '0' && c <= '9'); }

static void skip_blanks(TSLexer *lexer) {
    while (lexer->lookahead == ' ' || lexer->lookahead == '\t') lexer->advance(lexer, false);
}

// Looks ahead, behind the end of the token that is marked.
static bool begins_statement(TSLexer *lexer) {
    skip_blanks(lexer);
    if (!begins_name(lexer->lookahead)) return false;

    char word[LONGEST_WORD + 1] = {0};
    bool is_word = true;
    for (unsigned length = 0; continues_name(lexer->lookahead); length++) {
        if (length < LONGEST_WORD && lexer->lookahead < 0x80) {
            word[length] = (char)lexer->lookahead;
        } else {
            is_word = false;
        }
        lexer->advance(lexer, false);
    }
    for (unsigned i = 0; is_word && i < sizeof STATEMENTS / sizeof *STATEMENTS; i++) {
        if (strcmp(word, STATEMENTS[i]) == 0) return true;
    }

    skip_blanks(lexer);
    if (lexer->lookahead == '(') {
        lexer->advance(lexer, false);
        while (continues_name(lexer->lookahead) || lexer->lookahead == ',' || lexer->lookahead == ' ') {
            lexer->advance(lexer, false);
        }
        if (lexer->lookahead != ')') return false;
        lexer->advance(lexer, false);
        skip_blanks(lexer);
    }
    if (lexer->lookahead != '=') return false;
    lexer->advance(lexer, false);
    return lexer->lookahead != '=';
}

static bool newline(Scanner *scanner, TSLexer *lexer, const bool *valid) {
    bool is_carriage_return = lexer->lookahead == '\r';
    lexer->advance(lexer, false);
    if (is_carriage_return && lexer->lookahead == '\n') lexer->advance(lexer, false);
    lexer->mark_end(lexer);

    if (scanner->depth > 0 && !begins_statement(lexer)) {
        lexer->result_symbol = BLANK_NEWLINE;
        return valid[BLANK_NEWLINE];
    }
    if (!valid[NEWLINE]) return false;
    scanner->depth = 0;
    lexer->result_symbol = NEWLINE;
    return true;
}

static bool parenthesis(Scanner *scanner, TSLexer *lexer, const bool *valid, enum Token token) {
    if (!valid[token]) return false;
    lexer->advance(lexer, false);
    lexer->mark_end(lexer);
    if (token == OPEN_ROUND || token == OPEN_SQUARE) {
        if (scanner->depth < UINT16_MAX) scanner->depth++;
    } else if (scanner->depth > 0) {
        scanner->depth--;
    }
    lexer->result_symbol = token;
    return true;
}

void *tree_sitter_piola_external_scanner_create(void) { return ts_calloc(1, sizeof(Scanner)); }

void tree_sitter_piola_external_scanner_destroy(void *payload) { ts_free(payload); }

unsigned tree_sitter_piola_external_scanner_serialize(void *payload, char *buffer) {
    memcpy(buffer, payload, sizeof(Scanner));
    return sizeof(Scanner);
}

void tree_sitter_piola_external_scanner_deserialize(void *payload, const char *buffer, unsigned length) {
    Scanner *scanner = payload;
    scanner->depth = 0;
    if (length == sizeof(Scanner)) memcpy(scanner, buffer, length);
}

bool tree_sitter_piola_external_scanner_scan(void *payload, TSLexer *lexer, const bool *valid) {
    Scanner *scanner = payload;
    while (lexer->lookahead == ' ' || lexer->lookahead == '\t') lexer->advance(lexer, true);
    switch (lexer->lookahead) {
        case '\n':
        case '\r': return newline(scanner, lexer, valid);
        case '(': return parenthesis(scanner, lexer, valid, OPEN_ROUND);
        case ')': return parenthesis(scanner, lexer, valid, CLOSE_ROUND);
        case '[': return parenthesis(scanner, lexer, valid, OPEN_SQUARE);
        case ']': return parenthesis(scanner, lexer, valid, CLOSE_SQUARE);
        default: return false;
    }
}
