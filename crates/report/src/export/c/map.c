
/* Four weights of a spline along one axis, and their slopes. */
struct palpate_stencil {
    int first;
    float weights[4], slopes[4];
};

struct palpate_splines {
    float least[2], step[2];
    int cells[2];
    const float (*nodes)[USED];
};

static const struct palpate_splines RESPONSE = {RESPONSE_LEAST, RESPONSE_STEP, RESPONSE_CELLS, RESPONSE_NODES};
static const struct palpate_splines LEVERAGE = {LEVERAGE_LEAST, LEVERAGE_STEP, LEVERAGE_CELLS, LEVERAGE_NODES};

/* The best fit near a start. */
struct palpate_fit {
    float place[2], force_n, chi2, beyond, leverage;
};

/* What is known of a reading at a place. */
struct palpate_state {
    const float *used;
    int without;
    float value[USED], along_x[USED], along_y[USED], weight[USED], leverage[USED];
};

static float palpate_clamp(float value, float least, float most)
{
    return fminf(fmaxf(value, least), most);
}

static struct palpate_stencil palpate_find(const struct palpate_splines *splines, int axis, float value)
{
    struct palpate_stencil s;
    const float cell =
        palpate_clamp((value - splines->least[axis]) / splines->step[axis], 0.0f, (float)splines->cells[axis]);
    const float slope = 0.5f / splines->step[axis];
    float t, u;
    s.first = (int)cell < splines->cells[axis] - 1 ? (int)cell : splines->cells[axis] - 1;
    t = cell - (float)s.first;
    u = 1.0f - t;
    s.weights[0] = u * u * u / 6.0f;
    s.weights[1] = (4.0f + 3.0f * t * t * (t - 2.0f)) / 6.0f;
    s.weights[2] = (4.0f + 3.0f * u * u * (u - 2.0f)) / 6.0f;
    s.weights[3] = t * t * t / 6.0f;
    s.slopes[0] = -u * u * slope;
    s.slopes[1] = t * (3.0f * t - 4.0f) * slope;
    s.slopes[2] = u * (4.0f - 3.0f * u) * slope;
    s.slopes[3] = t * t * slope;
    return s;
}

/* Values at a place; the slopes too if they are wanted. */
static void palpate_values(const struct palpate_splines *splines, const float place[2], float *value, float *along_x,
                           float *along_y)
{
    const struct palpate_stencil x = palpate_find(splines, 0, place[0]), y = palpate_find(splines, 1, place[1]);
    int row, column, unit;
    for (unit = 0; unit < USED; unit++) {
        value[unit] = 0.0f;
        if (along_x) along_x[unit] = along_y[unit] = 0.0f;
    }
    for (row = 0; row < 4; row++) {
        for (column = 0; column < 4; column++) {
            const float *node = splines->nodes[(y.first + row) * (splines->cells[0] + 3) + x.first + column];
            for (unit = 0; unit < USED; unit++) {
                value[unit] += x.weights[column] * y.weights[row] * node[unit];
                if (along_x) {
                    along_x[unit] += x.slopes[column] * y.weights[row] * node[unit];
                    along_y[unit] += x.weights[column] * y.slopes[row] * node[unit];
                }
            }
        }
    }
}

static void palpate_respond(struct palpate_state *s, const float place[2])
{
    palpate_values(&RESPONSE, place, s->value, s->along_x, s->along_y);
}

static float palpate_noise(int unit, float output)
{
    return NOISE[0][unit] + NOISE[1][unit] * output * output;
}

static void palpate_weigh(struct palpate_state *s, float force_n)
{
    const float share = force_n / FORCE_N;
    int unit;
    for (unit = 0; unit < USED; unit++) {
        const float of_map = share * share * fmaxf(s->leverage[unit], 0.0f) * palpate_noise(unit, FORCE_N * s->value[unit]);
        s->weight[unit] = unit == s->without ? 0.0f : 1.0f / (palpate_noise(unit, force_n * s->value[unit]) + of_map);
    }
}

/* Weighted mean of a column, which an offset common to all outputs removes. */
static float palpate_offset(const struct palpate_state *s, const float column[USED])
{
    float sum = 0.0f, weights = 0.0f;
    int unit;
    if (!COMMON_OFFSET) return 0.0f;
    for (unit = 0; unit < USED; unit++) {
        sum += s->weight[unit] * column[unit];
        weights += s->weight[unit];
    }
    return sum / weights;
}

/* The force that fits best with the weights. */
static float palpate_force_n(const struct palpate_state *s)
{
    const float output_0 = palpate_offset(s, s->used), value_0 = palpate_offset(s, s->value);
    float projected = 0.0f, length = 0.0f;
    int unit;
    if (CONSTANT_LOAD) return FORCE_N;
    for (unit = 0; unit < USED; unit++) {
        const float value = s->value[unit] - value_0;
        projected += s->weight[unit] * (s->used[unit] - output_0) * value;
        length += s->weight[unit] * value * value;
    }
    return length > 0.0f ? projected / length : 0.0f;
}

static float palpate_chi2(const struct palpate_state *s, float force_n)
{
    const float offset = palpate_offset(s, s->used) - force_n * palpate_offset(s, s->value);
    float sum = 0.0f;
    int unit;
    for (unit = 0; unit < USED; unit++) {
        const float left = s->used[unit] - offset - force_n * s->value[unit];
        sum += s->weight[unit] * left * left;
    }
    return sum;
}

/* Step to the least squares along the free unknowns; no step if they can't be distinguished. */
static void palpate_step(const float information[3][3], const float slope[3], const int is_free[3], float step[3])
{
    float l[3][3] = {{0.0f}}, x[3];
    int i, j, k;
    for (i = 0; i < 3; i++) {
        step[i] = 0.0f;
        x[i] = is_free[i] ? slope[i] : 0.0f;
    }
    for (i = 0; i < 3; i++) {
        for (j = 0; j <= i; j++) {
            const float own = is_free[i] && is_free[j] ? information[i][j] : (i == j ? 1.0f : 0.0f);
            float rest = own;
            for (k = 0; k < j; k++) rest -= l[i][k] * l[j][k];
            if (i != j) l[i][j] = rest / l[j][j];
            else if (rest > LEAST_PIVOT * own) l[i][i] = sqrtf(rest);
            else return;
        }
    }
    for (i = 0; i < 3; i++) {
        for (k = 0; k < i; k++) x[i] -= l[i][k] * x[k];
        x[i] /= l[i][i];
    }
    for (i = 2; i >= 0; i--) {
        for (k = i + 1; k < 3; k++) x[i] -= l[k][i] * x[k];
        x[i] /= l[i][i];
    }
    for (i = 0; i < 3; i++) step[i] = x[i];
}

static float palpate_gain(const float slope[3], const float step[3])
{
    return slope[0] * step[0] + slope[1] * step[1] + slope[2] * step[2];
}

static int palpate_leaves(float at, float least, float most, float step)
{
    return (at <= least && step < 0.0f) || (at >= most && step > 0.0f);
}

/* Gauss-Newton steps from a start; after each one the force is eliminated. Returns whether something was fitted. */
static int palpate_descend(struct palpate_state *s, const float start[2], struct palpate_fit *fit)
{
    const float side = fmaxf(MOST_MM[0] - LEAST_MM[0], MOST_MM[1] - LEAST_MM[1]);
    float place[2] = {start[0], start[1]}, force_n;
    int steps = 0, unit, i, j;
    palpate_respond(s, place);
    palpate_values(&LEVERAGE, place, s->leverage, 0, 0);
    for (unit = 0; unit < USED; unit++) s->weight[unit] = 1.0f;
    force_n = palpate_force_n(s);
    for (;;) {
        float information[3][3] = {{0.0f}}, slope[3] = {0.0f}, step[3], freely[3], chi2 = 0.0f, x_0, y_0, value_0;
        float offset, length, share, next[2];
        int is_free[3] = {1, 1, !CONSTANT_LOAD}, halving;
        palpate_weigh(s, force_n);
        force_n = palpate_force_n(s);
        x_0 = palpate_offset(s, s->along_x);
        y_0 = palpate_offset(s, s->along_y);
        value_0 = palpate_offset(s, s->value);
        offset = palpate_offset(s, s->used) - force_n * value_0;
        for (unit = 0; unit < USED; unit++) {
            const float left = s->used[unit] - offset - force_n * s->value[unit];
            const float jacobian[3] = {force_n * (s->along_x[unit] - x_0), force_n * (s->along_y[unit] - y_0),
                                       s->value[unit] - value_0};
            for (i = 0; i < 3; i++) {
                slope[i] += s->weight[unit] * jacobian[i] * left;
                for (j = 0; j < 3; j++) information[i][j] += s->weight[unit] * jacobian[i] * jacobian[j];
            }
            chi2 += s->weight[unit] * left * left;
        }
        palpate_step((const float(*)[3])information, slope, is_free, freely);
        for (i = 0; i < 3; i++) step[i] = freely[i];
        for (i = 0; i < 2; i++) { /* along the border if the free step leaves the area */
            const int x = is_free[0] && palpate_leaves(place[0], LEAST_MM[0], MOST_MM[0], step[0]);
            const int y = is_free[1] && palpate_leaves(place[1], LEAST_MM[1], MOST_MM[1], step[1]);
            if (!x && !y) break;
            if (x) is_free[0] = 0;
            if (y) is_free[1] = 0;
            palpate_step((const float(*)[3])information, slope, is_free, step);
        }
        if (!(isfinite(chi2) && isfinite(step[0]) && isfinite(step[1]) && isfinite(step[2]))) return 0;
        length = sqrtf(step[0] * step[0] + step[1] * step[1]);
        share = length > LONGEST_STEP * side ? LONGEST_STEP * side / length : 1.0f;
        steps++;
        for (halving = 0;; halving++) {
            for (i = 0; i < 2; i++) next[i] = palpate_clamp(place[i] + share * step[i], LEAST_MM[i], MOST_MM[i]);
            if (halving == 0 && (palpate_gain(slope, step) < LAST_GAIN || steps == MOST_STEPS)) {
                fit->place[0] = next[0];
                fit->place[1] = next[1];
                fit->force_n = force_n + step[2];
                fit->chi2 = chi2;
                fit->beyond = palpate_gain(slope, freely) - palpate_gain(slope, step);
                fit->leverage = 0.0f;
                for (unit = 0; unit < USED; unit++) fit->leverage += s->leverage[unit] / USED;
                return 1;
            }
            if (halving > MOST_HALVINGS) break;
            palpate_respond(s, next);
            force_n = palpate_force_n(s);
            if (palpate_chi2(s, force_n) <= chi2) break;
            share *= 0.5f;
        }
        place[0] = next[0];
        place[1] = next[1];
        /* the map's error changes slowly: after the first step it stays */
        if (steps == 1) palpate_values(&LEVERAGE, place, s->leverage, 0, 0);
    }
}

/* Removes from a reading, in units of its noise, the part that a common offset could have caused. */
static void palpate_project_out(float row[USED])
{
    float length = 0.0f, share = 0.0f;
    int unit;
    for (unit = 0; unit < USED; unit++) {
        length += 1.0f / (SD[unit] * SD[unit]);
        share += row[unit] / SD[unit];
    }
    for (unit = 0; unit < USED; unit++) row[unit] -= share / length / SD[unit];
}

static float palpate_score(const float direction[USED], int start)
{
    float score = 0.0f;
    int unit;
    for (unit = 0; unit < USED; unit++) score += direction[unit] * DIRECTIONS[start][unit];
    return score;
}

/* Whether no neighbour of a start has a higher score. */
static int palpate_is_peak(const float direction[USED], int start, float score)
{
    const int column = start % STARTS_A_SIDE, line = start / STARTS_A_SIDE;
    int i, j;
    for (i = line > 0 ? line - 1 : 0; i <= line + 1 && i < STARTS_A_SIDE; i++) {
        for (j = column > 0 ? column - 1 : 0; j <= column + 1 && j < STARTS_A_SIDE; j++) {
            if (palpate_score(direction, i * STARTS_A_SIDE + j) > score) return 0;
        }
    }
    return 1;
}

/* Writes the starts whose directions are closest to the reading's, the closest first. Returns their number. */
static int palpate_seek(const float used[USED], int without, int starts[MOST_STARTS])
{
    float direction[USED], scores[MOST_STARTS], length = 0.0f, best_score = 0.0f;
    int unit, start, count = 0, best = -1, i;
    for (unit = 0; unit < USED; unit++) direction[unit] = unit == without ? 0.0f : used[unit] / SD[unit];
    if (COMMON_OFFSET && without < 0) palpate_project_out(direction);
    for (unit = 0; unit < USED; unit++) length += direction[unit] * direction[unit];
    length = sqrtf(length);
    if (!(length > 0.0f)) return 0;
    for (unit = 0; unit < USED; unit++) direction[unit] /= length;
    for (start = 0; start < STARTS; start++) {
        float score = palpate_score(direction, start);
        if (without >= 0) {
            const float own = DIRECTIONS[start][without];
            score /= sqrtf(fmaxf(1.0f - own * own, 1e-7f));
        }
        if (score > best_score) {
            best_score = score;
            best = start;
        }
    }
    if (best < 0) return 0;
    starts[count++] = best;
    if (without >= 0) return count;
    for (start = 0; start < STARTS; start++) {
        const float score = palpate_score(direction, start);
        if (start == best || score <= 0.0f || !palpate_is_peak(direction, start, score)) continue;
        for (i = 1; i < count && scores[i] >= score; i++) {}
        if (i == MOST_STARTS) continue;
        if (count < MOST_STARTS) count++;
        {
            int last;
            for (last = count - 1; last > i; last--) {
                starts[last] = starts[last - 1];
                scores[last] = scores[last - 1];
            }
        }
        starts[i] = start;
        scores[i] = score;
    }
    return count;
}

/* The best fit of a reading, of which one output may be left out. */
static int palpate_estimate(const float used[USED], int without, struct palpate_fit *best)
{
    struct palpate_state state;
    int starts[MOST_STARTS], is_found = 0, i;
    const int count = palpate_seek(used, without, starts);
    state.used = used;
    state.without = without;
    for (i = 0; i < count; i++) {
        struct palpate_fit fit;
        if (!palpate_descend(&state, START_PLACES[starts[i]], &fit)) continue;
        if (!is_found || fit.chi2 < best->chi2) *best = fit;
        is_found = 1;
    }
    return is_found;
}

/* Solves a reading: the place where the map fits it best. Returns the verdict. Needs no heap and changes no static data. */
int palpate_solve(const float *outputs, struct palpate_contact *contact)
{
    float used[USED], limit = MOST_CHI2;
    struct palpate_fit fit, other, without_one;
    int unit;
    contact->x_mm = contact->y_mm = contact->force_n = contact->misfit = contact->relative_force = NAN;
    contact->unit = 0;
    contact->verdict = PALPATE_UNSOLVED;
    if (!palpate_used(outputs, used) || !palpate_estimate(used, -1, &fit)) return contact->verdict;
    contact->verdict = PALPATE_OK;
    if (palpate_is_weak(used)) {
        contact->verdict = PALPATE_WEAK_SIGNAL;
    } else if (fit.chi2 > MOST_CHI2) {
        without_one.chi2 = MOST_CHI2_WITHOUT_ONE;
        contact->verdict = PALPATE_NOT_ONE_CONTACT;
        for (unit = 0; unit < USED; unit++) { /* outputs that look dead or too large */
            const float least = BROKEN_SD * sqrtf(NOISE[0][unit]);
            if (fabsf(used[unit]) >= least && used[unit] <= fit.force_n * LOUDEST[unit] + least) continue;
            if (palpate_estimate(used, unit, &other) && other.chi2 < without_one.chi2) {
                without_one = other;
                contact->unit = KEPT[unit] + 1;
            }
        }
        if (contact->unit > 0) {
            fit = without_one;
            limit = MOST_CHI2_WITHOUT_ONE;
            contact->verdict = PALPATE_CHANNEL_FAULT;
        }
    } else if (fit.beyond > INSIDE || fit.leverage > KNOWN) {
        contact->verdict = PALPATE_OUTSIDE_AREA;
    }
    contact->x_mm = fit.place[0];
    contact->y_mm = fit.place[1];
    if (FORCES_ARE_KNOWN) contact->force_n = fit.force_n;
    else contact->relative_force = fit.force_n;
    contact->misfit = fit.chi2 / limit;
    return contact->verdict;
}
