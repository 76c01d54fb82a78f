/* The cell model: an equivalent circuit whose parameters are tables over SOC and temperature.
 *
 *   z_s = z - rho sum d_k(T) i_k                                             SOC at the surface of the particles
 *   v = OCV(z_s, T) - rho (R0(z_s, T) i + e(z_s, T) asinh(i / i_ref) + sum R_k(z_s, T) i_k) + M h
 *
 * z SOC, i current (positive on discharge), i_k the current through the first-order lag of branch k, h hysteresis, rho
 * the resistance of this cell over that of its model. A plain circuit has no d_k, and one i_ref; a model of the surface
 * has an i_ref, twice the exchange current, for each SOC and temperature. Tables are even in SOC and linear between
 * their points.
 *
 * The last of the branches is no RC pair: 1 ohm, whose current no current drives. It is the lasting error of the model.
 */
#ifndef VW_CELL_MODEL_H
#define VW_CELL_MODEL_H

#include "vw_real.h"

#define VW_SECONDS_PER_HOUR ((vw_real)3600.0)

/* Columns of the table: after the resistances R_k the overpotential e and 1 / i_ref, where the model has them. */
enum { VW_OCV, VW_R0, VW_R1, VW_COLUMNS_MAX = 8 };

#if VW_RC_MAX > 5
#error "a point of the table holds OCV, R0, four resistances R_k, the overpotential and its current"
#endif

/* What is not known of a cell at a temperature. */
enum {
    VW_DROP_ERROR,   /* share by which its resistances may be off for want of measurements */
    VW_OCV_ERROR,    /* how far its OCV may be off [V] */
    VW_LASTING_DROP, /* voltage that a lasting current costs [V/A] */
    VW_COLD,         /* how much earlier than at 25 degC it looks empty */
    VW_LOWEST,       /* lowest SOC that its model has seen under load */
    VW_UNCERTAINTIES
};

typedef struct {
    int32_t n_rc;           /* branches: RC pairs and the lasting error, 1 .. VW_RC_MAX */
    int32_t n_soc;          /* SOC points of the tables, >= 2 */
    int32_t n_temperatures; /* temperatures of the tables, >= 1; one holds everywhere */
    int32_t has_overpotential;
    int32_t has_tau_table; /* whether time constants change with SOC or temperature */
    int32_t has_surface;   /* whether there are d_k and a table of i_ref */
    int32_t slow_pair;     /* the slowest RC pair, -1 without any */
    int32_t n_uncertainty;       /* temperatures of the uncertainty, >= 2 */
    int32_t width;         /* numbers from one point of the table to the next; 4 and 8 are fast on a PC */
    vw_real soc_low;             /* SOC of the first point */
    vw_real soc_step;            /* from one point to the next */
    vw_real capacity_ah;         /* between SOC 1 and 0 [Ah] */
    vw_real efficiency;          /* share of the charging charge that is kept */
    vw_real overpotential_a;     /* i_ref, where it is the same everywhere [A] */
    vw_real hysteresis_v;        /* M, half the gap between charge and discharge [V]; 0 = none */
    vw_real hysteresis_rate;     /* how fast h follows, per unit of SOC moved */
    vw_real drop_per_a_v;        /* voltage that a lasting current costs [V/A] */
    vw_real seen_a;              /* largest current that the model was made of [A] */
    vw_real uncertainty_low_degc;      /* first temperature of the uncertainty [degC] */
    vw_real uncertainty_step_k;        /* from one to the next [K] */
    const vw_real *temperature_degc; /* (n_temperatures) rising [degC] */
    const vw_real *table;        /* (n_temperatures, n_soc, width) [V, ohm, ohm .. V] */
    const vw_real *ocv_slope_v;  /* (n_soc) dOCV/dSOC [V] */
    const vw_real *reading_slope_v; /* (n_soc) volts per SOC at which a voltage reads the SOC, see tables.py [V] */
    const vw_real *tau_s;        /* (n_rc) time constants, or (n_temperatures, n_soc, n_rc) where has_tau_table [s] */
    const vw_real *uncertainty;        /* (n_uncertainty, VW_UNCERTAINTIES) */
    const vw_real *surface;      /* (n_temperatures, n_rc - 1) d_k [1/A], where has_surface */
} vw_cell_model;

/* Where the cells of a block lie in the tables: the temperature below, the point below, and the weights of the next. */
typedef struct {
    vw_lanes row; /* a whole number */
    vw_lanes row_weight;
} vw_temperature_place;

typedef struct {
    int32_t column[VW_LANES];
    vw_lanes weight;
} vw_soc_place;

/* What a table says of the cells of a block between two of its points, at their temperatures: low + weight rise. A cell
 * crosses a point seldom; between two, its numbers stand here in rows and nothing is looked up. */
typedef struct {
    int32_t column[VW_LANES]; /* the point below; VW_NOWHERE before the first look-up and after one of temperature */
    vw_lanes low[VW_COLUMNS_MAX];  /* the numbers of that point ... */
    vw_lanes rise[VW_COLUMNS_MAX]; /* ... and what those of the next one are more */
} vw_segment;

#define VW_NOWHERE (-1)

static inline vw_real vw_cell_model_interpolate(const vw_segment *segment, const vw_soc_place *soc, int column, int c)
{
    return segment->low[column][c] + soc->weight[c] * segment->rise[column][c];
}

/* RC pairs of the model: its branches but the lasting error. */
static inline int vw_cell_model_count_pairs(const vw_cell_model *model) { return model->n_rc - 1; }

/* Numbers in use at a point of the table. */
static inline int vw_cell_model_count_columns(const vw_cell_model *model)
{
    return VW_R1 + vw_cell_model_count_pairs(model) + model->has_overpotential + model->has_surface;
}

void vw_cell_model_place_temperature(const vw_cell_model *model, const vw_lanes temperature_degc,
                                     vw_temperature_place *place);
void vw_cell_model_place_soc(const vw_cell_model *model, const vw_lanes soc, vw_soc_place *place);

/* The uncertainty at each temperature: `uncertainty` has VW_UNCERTAINTIES rows. */
void vw_cell_model_read_uncertainty(const vw_cell_model *model, const vw_lanes temperature_degc, vw_lanes *uncertainty);

/* Bring the segments of a block up to the places of its cells: OCV, R0, R_k and e, or the OCV alone. */
void vw_cell_model_read_circuit(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc,
                                vw_segment *segment);
void vw_cell_model_read_ocv(const vw_cell_model *model, const vw_temperature_place *at, const vw_soc_place *soc,
                            vw_segment *segment);

/* Values of each cell in a segment: `values` has VW_COLUMNS_MAX rows, vw_cell_model_count_columns of them are set. */
void vw_cell_model_read_values(const vw_cell_model *model, const vw_segment *segment, const vw_soc_place *soc,
                               vw_lanes *values);

/* dOCV/dSOC [V] of each cell; its own table, which may be smoothed. */
void vw_cell_model_read_ocv_slope(const vw_cell_model *model, const vw_soc_place *soc, vw_lanes slope_v);

/* Time constants of each cell [s]: `tau_s` has n_rc rows. */
void vw_cell_model_read_time_constants(const vw_cell_model *model, const vw_temperature_place *at,
                                       const vw_soc_place *soc, vw_lanes *tau_s);

/* d_k of each cell [1/A]: `surface` has VW_RC_MAX - 1 rows, zeros where the model has none. */
void vw_cell_model_read_surface(const vw_cell_model *model, const vw_temperature_place *at, vw_lanes *surface);

/* Volts per SOC at which a voltage reads the SOC of each cell. */
void vw_cell_model_read_reading_slope(const vw_cell_model *model, const vw_soc_place *soc, vw_lanes slope_v);

/* OCV [V] of one cell. */
vw_real vw_cell_model_compute_ocv(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real soc);

/* How far the SOC may lie from `soc` where the voltage there has the standard deviation sigma_v. */
vw_real vw_cell_model_compute_soc_sigma(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real soc,
                                        vw_real sigma_v);

/* The SOC of cell c, -0.05 .. 1.05, whose OCV at its temperature is `voltage_v`. */
vw_real vw_cell_model_find_soc(const vw_cell_model *model, const vw_temperature_place *at, int c, vw_real voltage_v);

#endif
