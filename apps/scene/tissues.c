/* Young's moduli from the cited papers; where a paper gives the shear stiffness mu, E = 3 mu (incompressible). */
#include "tissues.h"

#include <ctype.h>
#include <string.h>

const char tissue_density_source[] = "IT'IS Foundation, tissue properties database, version 4";

/* Poisson's ratio: tissue is nearly incompressible (0.49 and above). Linear tetrahedra lock there and need more
 * substeps; 0.45 is the usual choice. */
static const tissue_constants rows[] = {
    {"tumour", "tumo cancer carcinoma lesion metasta hcc. neoplasm mass.", TISSUE_TUMOUR, 30e3, 0.45, 1079,
     "malignant liver tumours, MR elastography, mu 10.1 kPa: Venkatesh 2008, AJR 190:1534"},
    {"vessel", "vessel vein vena vascul artery aorta portal trunk. atrial cava", TISSUE_VESSEL, 30e3, 0.45, 1050,
     "chosen: a label fills the lumen too, and the wall's 620 kPa (veins: Umale 2011, J Biomech 44:1678) costs substeps"},
    {"bone",
     "bone rib. ribs. vertebra spine. sacrum sternum skull femur humer scapul clavic pelvis. hip. cartilage costal tibia "
     "cortical.",
     TISSUE_BONE, 50e3, 0.3, 1908,
     "chosen: held fast, so that its own 10 to 20 GPa, which would ask for thousands of substeps, are not needed"},
    {"liver", "liver hepat", TISSUE_SOFT, 5.5e3, 0.45, 1079,
     "429 healthy people, transient elastography, 5.49 kPa: Roulot 2008, J Hepatol 48:606"},
    {"gallbladder", "gallbladder gall_bladder", TISSUE_SOFT, 6e3, 0.45, 1000,
     "chosen: assumed as in apps/scenes/cholecystectomy.yaml, density of water; a label fills the bile too, papers have the "
     "wall alone"},
    {"kidney", "kidney renal", TISSUE_SOFT, 5.0e3, 0.45, 1066,
     "renal cortex, shear-wave elastography, 5.0 kPa: Arda 2011, AJR 197:532"},
    {"spleen", "spleen splen", TISSUE_SOFT, 2.9e3, 0.45, 1089,
     "shear-wave elastography, 2.9 kPa (other methods up to 20): Arda 2011, AJR 197:532"},
    {"pancreas", "pancrea", TISSUE_SOFT, 4.8e3, 0.45, 1087, "shear-wave elastography, 4.8 kPa: Arda 2011, AJR 197:532"},
    {"thyroid", "thyroid", TISSUE_SOFT, 11.0e3, 0.45, 1050,
     "shear-wave elastography, 10.97 kPa: Arda 2011, AJR 197:532"},
    {"salivary gland", "parotid submandib saliva", TISSUE_SOFT, 10.4e3, 0.45, 1048,
     "parotid, shear-wave elastography, 10.38 kPa: Arda 2011, AJR 197:532"},
    {"prostate", "prostat", TISSUE_SOFT, 17.0e3, 0.45, 1045,
     "indentation of specimens without cancer, 17.0 kPa: Ahn 2010, Urology 76:1007"},
    {"brain", "brain cerebr cerebel white_matter grey_matter gray_matter", TISSUE_SOFT, 1.9e3, 0.45, 1045,
     "white matter, indentation, 1.9 kPa: Budday 2015, J Mech Behav Biomed Mater 46:318"},
    {"muscle", "muscle gluteus psoas iliopsoas autochthon gastrocnem", TISSUE_SOFT, 11.1e3, 0.45, 1090,
     "gastrocnemius at rest, shear-wave elastography, 11.1 kPa: Arda 2011, AJR 197:532"},
    {"fat", "fat. adipos breast", TISSUE_SOFT, 3.25e3, 0.45, 911,
     "breast fat, compression, 3.25 kPa: Samani 2007, Phys Med Biol 52:1565"},
};
enum { ROWS = sizeof rows / sizeof *rows };

const tissue_constants tissue_unknown = {
    "unknown", "", TISSUE_SOFT, 5e3, 0.45, 1050, "a guess: between liver and kidney; put what you know here"};

const tissue_constants *tissue_row(int index) { return index >= 0 && index < ROWS ? rows + index : NULL; }

/* Returns whether a word of `name` begins with the `length` letters of `word` (`whole`: equals them). */
static bool has_word(const char *name, const char *word, size_t length, bool whole) {
    for (const char *at = name; *at; at++)
        if ((at == name || !isalpha((unsigned char)at[-1])) && strncmp(at, word, length) == 0 &&
            (!whole || !isalpha((unsigned char)at[length])))
            return true;
    return false;
}

const tissue_constants *tissue_find(const char *name) {
    char lower[128];
    size_t n = 0;
    for (; name[n] && n < sizeof lower - 1; n++)
        lower[n] = (char)(name[n] == ' ' || name[n] == '-' ? '_' : tolower((unsigned char)name[n]));
    lower[n] = 0;
    for (int r = 0; r < ROWS; r++)
        for (const char *word = rows[r].words; *word;) {
            size_t length = strcspn(word, " ");
            bool whole = word[length - 1] == '.';
            if (has_word(lower, word, length - whole, whole)) return rows + r;
            word += length + (word[length] == ' ');
        }
    return NULL;
}
