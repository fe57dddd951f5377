/* Inside study_write_yaml: a scene's text. */
#ifndef TM_STUDY_YAML_H
#define TM_STUDY_YAML_H

#include <stdbool.h>

/* `text`, whole, has room for what is put in. Key of the `number`-th item of a list of the top level: in, or, `value`
 * null, out. False: there is no such item or key. */
bool study_yaml_item(char *text, const char *list, int number, const char *key, const char *value);

#endif
