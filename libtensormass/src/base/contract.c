/* Who is told of a broken contract. The only place of the library that prints or ends the program, and only until the
 * caller sets a handler of its own. */
#include "base/contract.h"

#include <stdio.h>
#include <stdlib.h>

static void default_contract_handler(const char *function, const char *sentence, void *user) {
    (void)user;
    fprintf(stderr, "%s: %s; this is a fault of the program that calls it\n", function, sentence);
    abort();
}

static tm_contract_handler contract_handler = default_contract_handler;
static void *contract_user;

void tm_set_contract_handler(tm_contract_handler handler, void *user) {
    contract_handler = handler ? handler : default_contract_handler;
    contract_user = user;
}

void tm_contract_broken(const char *function, const char *sentence) {
    contract_handler(function, sentence, contract_user);
}
