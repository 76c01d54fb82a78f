/* What the tests' own descriptions of the structs are held against. */
#include "master/vw_balance.h"
#include "master/vw_measuring.h"
#include "master/vw_slaves.h"

size_t size_of_slaves(void);
size_t size_of_balance(void);
size_t size_of_measuring(void);
size_t size_of_inputs(void);

size_t size_of_slaves(void)
{
    return sizeof(vw_slaves_t);
}

size_t size_of_balance(void)
{
    return sizeof(vw_balance_t);
}

size_t size_of_measuring(void)
{
    return sizeof(vw_measuring_t);
}

size_t size_of_inputs(void)
{
    return sizeof(vw_inputs_t);
}
