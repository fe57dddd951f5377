/* Includes NAME_law.h of each row of TM_NONLINEAR_LAWS, in its order. The preprocessor has no loop: a block for each of
 * the first twelve rows. */
#ifndef TM_LAW_FILE
#define TM_LAW_ROWS_ONE(NAME, name) +1
#define TM_LAW_ROWS (0 TM_NONLINEAR_LAWS(TM_LAW_ROWS_ONE))
#define TM_LAW_NAME(NAME, name) name,
#define TM_LAW_PICK(number, ...) TM_LAW_PICK_##number(__VA_ARGS__)
#define TM_LAW_PICK_1(a, ...) a
#define TM_LAW_PICK_2(a, ...) TM_LAW_PICK_1(__VA_ARGS__)
#define TM_LAW_PICK_3(a, ...) TM_LAW_PICK_2(__VA_ARGS__)
#define TM_LAW_PICK_4(a, ...) TM_LAW_PICK_3(__VA_ARGS__)
#define TM_LAW_PICK_5(a, ...) TM_LAW_PICK_4(__VA_ARGS__)
#define TM_LAW_PICK_6(a, ...) TM_LAW_PICK_5(__VA_ARGS__)
#define TM_LAW_PICK_7(a, ...) TM_LAW_PICK_6(__VA_ARGS__)
#define TM_LAW_PICK_8(a, ...) TM_LAW_PICK_7(__VA_ARGS__)
#define TM_LAW_PICK_9(a, ...) TM_LAW_PICK_8(__VA_ARGS__)
#define TM_LAW_PICK_10(a, ...) TM_LAW_PICK_9(__VA_ARGS__)
#define TM_LAW_PICK_11(a, ...) TM_LAW_PICK_10(__VA_ARGS__)
#define TM_LAW_PICK_12(a, ...) TM_LAW_PICK_11(__VA_ARGS__)
#define TM_LAW_TEXT(path) #path
#define TM_LAW_PATH(path) TM_LAW_TEXT(path)
#define TM_LAW_JOIN(name) name##_law.h
#define TM_LAW_JOINED(name) TM_LAW_JOIN(name)
#define TM_LAW_FILE(number) TM_LAW_PATH(TM_LAW_JOINED(TM_LAW_PICK(number, TM_NONLINEAR_LAWS(TM_LAW_NAME))))
_Static_assert(TM_LAW_ROWS <= 12, "material/law_files.h includes the files of twelve rows");
#endif

#if TM_LAW_ROWS >= 1
#include TM_LAW_FILE(1)
#endif
#if TM_LAW_ROWS >= 2
#include TM_LAW_FILE(2)
#endif
#if TM_LAW_ROWS >= 3
#include TM_LAW_FILE(3)
#endif
#if TM_LAW_ROWS >= 4
#include TM_LAW_FILE(4)
#endif
#if TM_LAW_ROWS >= 5
#include TM_LAW_FILE(5)
#endif
#if TM_LAW_ROWS >= 6
#include TM_LAW_FILE(6)
#endif
#if TM_LAW_ROWS >= 7
#include TM_LAW_FILE(7)
#endif
#if TM_LAW_ROWS >= 8
#include TM_LAW_FILE(8)
#endif
#if TM_LAW_ROWS >= 9
#include TM_LAW_FILE(9)
#endif
#if TM_LAW_ROWS >= 10
#include TM_LAW_FILE(10)
#endif
#if TM_LAW_ROWS >= 11
#include TM_LAW_FILE(11)
#endif
#if TM_LAW_ROWS >= 12
#include TM_LAW_FILE(12)
#endif
