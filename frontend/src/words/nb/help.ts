// Norwegian: the help page.
export const HELP = {
  'What each number means': 'Hva hvert tall betyr',
  Words: 'Ord',
  Shapes: 'Former',
  'How a configuration is changed': 'Slik endres en konfigurasjon',
  'Edit values on the Parameters page: this is a draft and changes nothing yet.':
    'Endre verdier på Parametere-siden: dette er et utkast og endrer ingenting ennå.',
  'Write: the master takes the draft, it is read back, and the page says whether both agree.':
    'Skriv: masteren tar utkastet, det leses tilbake, og siden sier om begge stemmer.',
  'Store: the EEPROM takes what is in force, so that it survives a restart.':
    'Lagre: EEPROM tar det som gjelder, slik at det overlever en omstart.',
  'The service shows and advises. The master protects: nothing on these pages can weaken that.':
    'Tjenesten viser og gir råd. Masteren beskytter: ingenting på disse sidene kan svekke det.',
  'One module of ten 18650 cans in parallel: the smallest thing whose voltage is measured. 96 of them.':
    'En modul av ti 18650-celler i parallell: det minste det måles spenning på. Det er 96 av dem.',
  'Twelve cells with one slave board. The rules say segment. Eight of them.':
    'Tolv celler med ett slavekort. Reglene sier segment. Det er åtte av dem.',
  'All eight packs in series, 96 cells.': 'Alle åtte pakkene i serie, 96 celler.',
  'The computer of the battery management system. It measures, protects and keeps the configuration.':
    'Datamaskinen i batteristyringen. Den måler, beskytter og holder konfigurasjonen.',
  'The board on a pack that measures its twelve cells and bleeds them.':
    'Kortet på en pakke som måler de tolv cellene og tapper dem.',
  'In force': 'Gjeldende',
  'The configuration the master works with now. It is lost at a restart unless it is stored.':
    'Konfigurasjonen masteren arbeider med nå. Den går tapt ved omstart hvis den ikke lagres.',
  EEPROM: 'EEPROM',
  'The master’s lasting memory. At its start the master takes the configuration from here.':
    'Masterens varige minne. Ved start henter masteren konfigurasjonen herfra.',
  'A car in the computer: its master speaks as a real one does. Its page is there only while it is watched.':
    'En bil i datamaskinen: masteren dens snakker som en ekte. Siden finnes bare mens den følges.',
  Session: 'Økt',
  'One recording: every byte as it came off the line, with estimates, events and markers.':
    'Ett opptak: hver byte slik den kom av linjen, med estimater, hendelser og markører.',
  'The lowest state of charge of all 96 cells in whole percent, rounded down. What the driver may still use.':
    'Den laveste ladetilstanden av alle 96 celler i hele prosent, rundet ned. Det føreren ennå kan bruke.',
  'Charge left in a cell, as a share of what it holds when full. Estimated, with its uncertainty.':
    'Ladning igjen i en celle, som andel av full. Estimert, med usikkerhet.',
  'One standard deviation of the SOC estimate. The true value lies within three sigma almost always.':
    'Ett standardavvik av SOC-estimatet. Den sanne verdien ligger nesten alltid innenfor tre sigma.',
  'Positive while the accumulator is discharged, negative while it is charged or the car brakes.':
    'Positiv når akkumulatoren lades ut, negativ når den lades eller bilen bremser.',
  'The highest cell voltage minus the lowest. A growing delta under load points to a weak cell or a bad joint.':
    'Høyeste cellespenning minus laveste. Vokser den under last, tyder det på en svak celle eller en dårlig skjøt.',
  'A cell’s voltage minus the mean of all cells at that moment.':
    'Cellens spenning minus snittet av alle celler i samme øyeblikk.',
  'The resistance a cell shows at once when current flows, its joint included.':
    'Motstanden cellen viser straks strømmen går, skjøten medregnet.',
  'Resistance of a cell’s busbar joint beyond that of its neighbours. A joint that has grown is named loose: tighten its bolt.':
    'Motstand i cellens skinneskjøt ut over naboenes. En skjøt som har vokst, kalles løs: stram bolten.',
  'What a cell holds when full, as a share of what it held when new.':
    'Hva cellen rommer når den er full, som andel av det den rommet som ny.',
  'Power ahead': 'Effekt framover',
  'What can be held for the next 1, 10 or 30 seconds before a cell meets a limit. The limiting cell and limit stand beside it.':
    'Det som kan holdes de neste 1, 10 eller 30 sekundene før en celle når en grense. Cellen og grensen står ved siden av.',
  'Time until the first cell meets a limit, at the present current and at the full current the master allows.':
    'Tid til den første cellen når en grense, ved nåværende strøm og ved den fulle strømmen masteren tillater.',
  'What can still be taken out until the first cell is empty, with one sigma.':
    'Det som ennå kan tas ut til den første cellen er tom, med ett sigma.',
  'Energy left divided by the energy of the laps driven. The band holds the truth nine times in ten.':
    'Energi igjen delt på energien i rundene som er kjørt. Båndet treffer ni av ti ganger.',
  'What the model did not foresee of a cell’s voltage. Near zero when the model fits.':
    'Det modellen ikke forutså av cellens spenning. Nær null når modellen passer.',
  'Cells that deliver a voltage. Fewer than 96 means a missing measurement.':
    'Celler som leverer en spenning. Færre enn 96 betyr at en måling mangler.',
  'Charge counted by the master itself since it last saw a full accumulator.':
    'Ladning som masteren selv har talt siden den sist så en full akkumulator.',
  Age: 'Alder',
  'Time since the bytes of a value left the line. After one second a value is marked stale; after ten it is no longer shown.':
    'Tid siden verdiens byte forlot linjen. Etter ett sekund merkes en verdi som gammel; etter ti vises den ikke lenger.',
  'trip: the master opens the relays, or is about to':
    'utløst: masteren åpner releene, eller er på vei til det',
  'warning: act now, or it trips': 'advarsel: handle nå, ellers løser den ut',
  'watch: keep an eye on it': 'følg med: hold øye med det',
  'live: bytes arrive': 'lever: byte kommer inn',
  'silent: connected, but nothing arrives': 'stille: tilkoblet, men ingenting kommer',
  'lost: no connection; it is tried again by itself': 'tapt: ingen forbindelse; den prøves igjen av seg selv',
  'off: not used': 'av: ikke i bruk',
} as const;
