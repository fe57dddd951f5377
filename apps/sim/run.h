/* The modes of tm-sim. Each takes a built scene and returns the exit code, after an error message if it failed. */
#ifndef TM_SIM_RUN_H
#define TM_SIM_RUN_H

#include "result_file.h"
#include "scene/sim.h"

typedef enum run_mode {
    RUN_NONE = 0,
    RUN_LOCKSTEP,
    RUN_REALTIME,
    RUN_SETTLE,
    RUN_EXPLAIN,
    RUN_CHECK,
    RUN_HANDS,
    RUN_TRIALS
} run_mode;

enum { RUN_MAX_SETS = 64 };

typedef struct run_options {
    const char *scene, *schema, *csv, *samples, *write, *json, *url, *key, *hands, *paraview, *snapshot, *restore,
        *trials;
    int64_t paraview_every;
    bool no_key;
    run_mode mode;
    double tolerance, snapshot_s, duration_s; /* duration_s below 0: the scene's */
    int64_t frames;                           /* below 0: computed from the duration */
    char *set[RUN_MAX_SETS];
    int set_count;
    bool strict, list;
} run_options;

int run_lockstep(sim *s, const run_options *o);
int run_realtime(sim *s, const run_options *o);
int run_settle(sim *s, const run_options *o);
int run_explain(sim *s, const run_options *o);
int run_hands(sim *s, const run_options *o);
/* Answers the requests of o->trials on stdout; builds the scene anew for each. */
int run_trials(const run_options *o);
/* Sums the force of a support on the tissue over the components that it holds: vertices may have several supports. */
void run_support_force(const sim *s, int support, const double *reaction, double sum[3]);
/* Moves every instrument to its start along its shaft, from the trocar. Placed there at once, it could be inside the
 * tissue without having touched it. */
tm_status run_insert_tools(sim *s);
/* Prints the scenes that come with the programs, the models and the effects on stdout. */
int run_list(void);

/* Result of a run whose tissue became unstable: its output files are kept as evidence. */
enum { RUN_UNSTABLE = -1 };
/* Reports the instability and returns RUN_UNSTABLE. */
int run_unstable(int64_t frame);

/* Returns 130 or 143 after a message if a signal ended a run of limited length; else 0. */
int run_say_interrupted(int64_t frame, int64_t total);

/* Creates the cJSON object with the part common to all reports: scene, mesh, step, memory. */
struct cJSON;
struct cJSON *run_report_begin(const sim *s, const char *mode);
/* Adds, for scenes that send more than forces, how many samples on tissue had those contents. */
void run_report_coverage(const sim *s, struct cJSON *report);
/* Adds how many ties between bodies are whole and how many went, if the scene has any. */
void run_report_ties(const sim *s, struct cJSON *report);
/* Contact of tissue with tissue: rows with a force, the sum of these forces; warns if rows were dropped. */
void run_report_touch(const sim *s, struct cJSON *report, bool print);
/* Prints a line about ties, if any are gone. */
void run_print_ties(const sim *s);
/* Adds how many steps took how many substeps, if they are adaptive. */
void run_report_adaptive(const sim *s, struct cJSON *report);
/* Adds the figures of the effect `energy` if the scene has it. */
void run_report_energy(const sim *s, struct cJSON *report);

#endif
