/* A contact. Places are in the specimen frame. */
struct palpate_contact {
    float x_mm, y_mm; /* place */
    float force_n;    /* force, along the inward normal; NAN if the calibration has no forces */
    float misfit;     /* 1 is the largest of a single contact; NAN if it is unknown */
    int verdict;      /* PALPATE_OK, ... */
    int unit;         /* the output that contradicts all others, from 1; 0 if there is none */
    float relative_force; /* force, 1 is a typical press of a calibration without forces; else NAN */
};

enum {
    PALPATE_OK = 0,
    PALPATE_WEAK_SIGNAL = 1,     /* the reading may be one without a contact */
    PALPATE_OUTSIDE_AREA = 2,    /* outside the calibrated area */
    PALPATE_NOT_ONE_CONTACT = 3, /* no single contact gives this reading */
    PALPATE_CHANNEL_FAULT = 4,   /* the reading without the output `unit` is one contact */
    PALPATE_UNSOLVED = 5         /* equal outputs, or one that is not a finite number */
};

#ifdef __cplusplus
extern "C" {
#endif

/* Solves a reading of PALPATE_OUTPUTS outputs. Returns the verdict, which is in the contact too. Threads may call it at once. */
int palpate_solve(const float *outputs, struct palpate_contact *contact);

#ifdef __cplusplus
}
#endif

