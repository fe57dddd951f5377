/* Words of a scene's choices: one table per choice, one row per word with its value. A choice is read as a position in
 * its table and cast to the value. APP_CHOICE_CHECK(TABLE) does not compile if they differ. */
#ifndef TM_CHOICES_H
#define TM_CHOICES_H

#define APP_PRECISIONS(ROW) ROW("double", TM_DOUBLE) ROW("single", TM_SINGLE)
#define APP_FORCE_FORMS(ROW) ROW("best", TM_FORCE_BEST) ROW("plain", TM_FORCE_PLAIN)
#define APP_TOOL_MODES(ROW) ROW("probe", TM_TOOL_PROBE) ROW("grasper", TM_TOOL_GRASPER) ROW("cautery", TM_TOOL_CAUTERY)

/* "double|single", the format of a field's `unit` */
#define APP_CHOICE_BAR(word, value) "|" word
#define APP_CHOICE_WORDS(TABLE) (&TABLE(APP_CHOICE_BAR)[1])
/* {"double", "single"} */
#define APP_CHOICE_WORD(word, value) word,
#define APP_CHOICE_LIST(TABLE)                                                                                         \
    { TABLE(APP_CHOICE_WORD) }

#define APP_CHOICE_PLACE(word, value) APP_CHOICE_AT_##value,
#define APP_CHOICE_SAME(word, value)                                                                                   \
    _Static_assert((int)APP_CHOICE_AT_##value == (int)(value), word " is not at the index of its value");
#define APP_CHOICE_CHECK(TABLE)                                                                                        \
    enum { TABLE(APP_CHOICE_PLACE) };                                                                                  \
    TABLE(APP_CHOICE_SAME)

#endif
