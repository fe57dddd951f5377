/* What the programs' parts would print on stderr, kept for the caller of the library instead. */
#ifndef TM_SAID_H
#define TM_SAID_H

#include "tensormass/base.h"

/* Forgets what this thread said before. */
void said_begin(void);
/* The library's status behind an exit code of the programs, `otherwise` where there is none. */
tm_status said_status(int exit_code, tm_status otherwise);

#endif
